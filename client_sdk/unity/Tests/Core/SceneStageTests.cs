using System;
using System.Collections.Generic;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>The swap: in one update, of exactly what was declared, and of nothing else.</summary>
    [TestFixture]
    public class SceneStageTests
    {
        [Test]
        public void Landing_IsShownInOneSwap_WithTheBaseByBruteForce()
        {
            var bench = new StageBench();
            bench.LandOn(3, 1, 4, 15, 9, 2);
            bench.Frames(60);
            Assert.AreEqual(2, bench.Renderer.Swaps.Count, "the base, then the landing");
            Assert.IsTrue(bench.Renderer.Swaps[0].IsNewBase);
            Assert.AreEqual(6, bench.Renderer.Swaps[1].Shown.Count);
            Assert.IsTrue(bench.Shows(1, 2, 3, 4, 9, 15));
            Assert.AreEqual(LandingPhase.Shown, bench.Stage.Status.Phase);
            Assert.AreEqual(new uint[] { 1, 2, 3, 4, 9, 15 }, bench.Stage.Visible);
        }

        [Test]
        public void TwoLevels_LandingsAndAimsAskForARing_UnlessOneIsNamedOrNobodyWantsIt()
        {
            var bench = new StageBench(levels: 2);
            bench.Stage.Land(new Vec3(1, 2, 3), 40);
            bench.Stage.Aim(new Vec3(1, 2, 3), 20);
            Assert.AreEqual(120, bench.Stream.LandedRingM);
            Assert.AreEqual(60, bench.Stream.AimedRingM);
            var own = new LandOptions { InnerRadiusM = 5 };
            bench.Stage.Land(new Vec3(1, 2, 3), 40, own);
            Assert.AreEqual(120, bench.Stream.LandedRingM);
            Assert.IsNull(own.CoarseRadiusM, "the caller's options stay as they are");
            bench.Stage.Land(new Vec3(1, 2, 3), 40, new LandOptions { CoarseRadiusM = 50 });
            Assert.AreEqual(50, bench.Stream.LandedRingM);
            bench.Stage.ShowsCoarse = false;
            bench.Stage.Land(new Vec3(1, 2, 3), 40);
            bench.Stage.Aim(new Vec3(1, 2, 3), 20);
            Assert.IsNull(bench.Stream.LandedRingM);
            Assert.IsNull(bench.Stream.AimedRingM);
            Assert.IsFalse(new StageBench(1, options => options.ShowsCoarse = false, 2).Stage.ShowsCoarse);
        }

        [Test]
        public void OneLevel_NoRingIsAskedFor()
        {
            var bench = new StageBench();
            bench.Stage.Land(new Vec3(1, 2, 3), 40);
            Assert.IsNull(bench.Stream.LandedRingM);
        }

        [Test]
        public void TwoLevels_AHopExchangesThem_AndTheBaseGivesWayToBoth()
        {
            const uint Coarse = StageBench.SegmentCount;
            var bench = new StageBench(levels: 2);
            bench.LandOn(3, 4, Coarse + 5, Coarse + 9);
            bench.Frames(60);
            Assert.IsTrue(bench.Shows(3, 4, Coarse + 5, Coarse + 9));
            int hidden = bench.Stage.HiddenBaseFaces;
            Assert.Greater(hidden, 0);
            // The other way round: the same segments, so the same faces of the base.
            bench.LandOn(5, 9, Coarse + 3, Coarse + 4);
            bench.Frames(60);
            Assert.IsTrue(bench.Shows(5, 9, Coarse + 3, Coarse + 4));
            Assert.AreEqual(hidden, bench.Stage.HiddenBaseFaces);
            Assert.AreEqual(0, bench.Renderer.Swaps[bench.Renderer.Swaps.Count - 1].ChangedBlocks.Count);
        }

        [Test]
        public void Walk_AlwaysEndsAtWhatWasDeclared()
        {
            for (uint seed = 1; seed <= 10; seed++)
            {
                // 1. A renderer with moods: several calls an upload, several frames until drawable.
                var noise = new Noise(seed);
                var bench = new StageBench(seed, options => options.SpareGpuBytes = 5 * StageBench.SegmentBytes);
                bench.Renderer.CallsPerUpload = 1 + noise.Below(3);
                bench.Renderer.FramesToWarm = noise.Below(3);
                string digest = bench.Stage.VisibleDigest;
                for (int hop = 0; hop < 15; hop++)
                {
                    // 2. A hop, now and then with an aim before it, left early half of the time.
                    uint[] segments = Some(noise);
                    if (noise.Below(3) == 0)
                    {
                        bench.Arrive(null, Some(noise));
                        bench.Frames(noise.Below(20));
                        digest = bench.Stage.VisibleDigest;
                    }
                    bench.LandOn(segments);
                    int frames = noise.Below(2) == 0 ? 400 : noise.Below(40);
                    for (int frame = 0; frame < frames; frame++)
                    {
                        // Invariant, frame by frame: what is visible changes in swaps alone, and spare memory keeps its bound.
                        int swaps = bench.Renderer.Swaps.Count;
                        bench.Frames(1);
                        bool hasSwapped = bench.Renderer.Swaps.Count > swaps;
                        Assert.IsTrue(hasSwapped || digest == bench.Stage.VisibleDigest, "what is visible changed without a swap");
                        digest = bench.Stage.VisibleDigest;
                        Assert.LessOrEqual(bench.Stage.Stats.SpareGpuBytes, 5 * StageBench.SegmentBytes);
                    }
                    // 3. Given time, exactly what was declared is shown, and nothing else but spares is on the card.
                    if (frames == 400)
                    {
                        Assert.IsTrue(bench.Shows(segments), "seed " + seed + " hop " + hop);
                        bench.Frames(5);
                        int spare = (int)(bench.Stage.Stats.SpareGpuBytes / StageBench.SegmentBytes);
                        Assert.AreEqual(segments.Length + spare, bench.Renderer.Uploaded, "what nobody needs is freed");
                    }
                }
                bench.Stage.Dispose();
                Assert.AreEqual(0, bench.Renderer.Uploaded, "all is freed");
            }
        }

        [Test]
        public void Nearby_StaysUploaded_AndIsShownAgainAtOnce()
        {
            var bench = new StageBench();
            bench.LandOn(1, 2, 3);
            bench.Frames(60);
            int hop = bench.Land();
            bench.Plan(hop, new uint[] { 4 }, new uint[] { 1 }, new uint[] { 2 });
            bench.Arrive(hop, 4);
            bench.Ready(hop, 1, 4);
            bench.Frames(60);
            Assert.IsTrue(bench.Shows(1, 4));
            Assert.AreEqual(3, bench.Renderer.Uploaded, "1, 4 and 2, which is not shown; 3 is freed");
            // Its payload is gone, its mesh on the GPU is not.
            bench.Stream.Drop(2);
            int back = bench.Land();
            bench.Plan(back, new uint[0], new uint[] { 1, 2 });
            bench.Ready(back, 1, 2);
            bench.Frames(60);
            Assert.IsTrue(bench.Shows(1, 2), "2 needed no payload");
            Assert.AreEqual(2, bench.Renderer.Uploaded);
        }

        [Test]
        public void Newer_TakesThePlaceOfOneThatWasNotShown()
        {
            var bench = new StageBench();
            bench.Frames(10);
            int first = bench.Land();
            bench.Plan(first, new uint[] { 1, 2, 3 });
            bench.Arrive(first, 1, 2);
            bench.Frames(3);
            // Before the first was whole.
            int second = bench.LandOn(7, 8);
            bench.Ready(first, 1, 2, 3); // Too late: it counts no more.
            bench.Frames(60);
            Assert.IsTrue(bench.Shows(7, 8));
            Assert.AreEqual(second, bench.Stage.Status.Landing);
            Assert.AreEqual(2, bench.Renderer.Uploaded, "the first one's segments are freed");
        }

        [Test]
        public void Show_IsWaitedFor_WhereTheOwnerFades()
        {
            var bench = new StageBench(1, options => options.AutoShow = false);
            bench.LandOn(5, 6);
            // Two owners: one asks before anything is there, one after all is.
            Assert.IsFalse(bench.Stage.Show() && bench.Renderer.Shown.Count > 0, "nothing is there yet");
            var patient = new StageBench(1, options => options.AutoShow = false);
            patient.LandOn(5, 6);
            patient.Frames(100);
            Assert.AreEqual(LandingPhase.Presentable, patient.Stage.Status.Phase);
            Assert.AreEqual(0, patient.Renderer.Shown.Count);
            Assert.IsTrue(patient.Stage.Show());
            Assert.IsTrue(patient.Shows(5, 6));
            Assert.IsFalse(patient.Stage.Show(), "it is shown already");
            bench.Frames(100);
            Assert.IsTrue(bench.Shows(5, 6), "asked for before it was there");
        }

        [Test]
        public void Degraded_IsShownFirst_ThenTheRest()
        {
            var bench = new StageBench();
            int landing = bench.Land();
            bench.Plan(landing, new uint[] { 1, 2, 3, 4 });
            bench.Arrive(landing, 1, 2);
            bench.Degrade(landing, 1, 2);
            bench.Frames(60);
            Assert.IsTrue(bench.Shows(1, 2));
            Assert.IsTrue(bench.Renderer.Swaps[1].IsDegraded);
            bench.Arrive(landing, 3, 4);
            bench.Ready(landing, 1, 2, 3, 4);
            bench.Frames(60);
            Assert.IsTrue(bench.Shows(1, 2, 3, 4));
            Assert.AreEqual(3, bench.Renderer.Swaps.Count);
        }

        [Test]
        public void Damaged_CountsAsMissing_AndItsBaseStays()
        {
            var bench = new StageBench();
            var failed = new List<uint>();
            bench.Stage.DecodeFailed += (segment, error) => failed.Add(segment);
            // Three ways to fail: the renderer refuses it, its bytes are no payload, the cache has let it go.
            bench.Renderer.Unusable.Add(2);
            int landing = bench.Land();
            bench.Plan(landing, new uint[] { 1, 2, 3, 4 });
            bench.Arrive(landing, 1, 2, 3, 4);
            bench.Stream.Hold(3, new byte[100]);
            bench.Stream.Drop(4);
            bench.Ready(landing, 1, 2, 3, 4);
            bench.Frames(80);
            Assert.IsTrue(bench.Shows(1));
            failed.Sort();
            Assert.AreEqual(new uint[] { 2, 3 }, failed, "a payload that is not held is the cache's doing, not a fault");
            Assert.AreEqual(new uint[] { 2, 3, 4 }, bench.Stage.Status.Missing);
            // It comes once more, whole this time.
            bench.Renderer.Unusable.Clear();
            landing = bench.LandOn(1, 2, 3, 4);
            bench.Frames(80);
            Assert.IsTrue(bench.Shows(1, 2, 3, 4));
            Assert.AreEqual(0, bench.Stage.Status.Missing.Count);
        }

        [Test]
        public void Refused_LeavesWhatIsShown()
        {
            var bench = new StageBench();
            bench.LandOn(1, 2);
            bench.Frames(60);
            int landing = bench.Land();
            bench.Handle(new StreamEvent { Kind = StreamEventKind.Refused, Landing = landing, Code = "invalid", Message = "too far" });
            bench.Frames(20);
            Assert.IsTrue(bench.Shows(1, 2));
            Assert.AreEqual(LandingPhase.Refused, bench.Stage.Status.Phase);
            Assert.AreEqual("too far", bench.Stage.Status.Refusal);
        }

        [Test]
        public void Budget_IsPassedByOneStepAtMost()
        {
            var bench = new StageBench(1, options => options.MaxInFlight = 64);
            bench.Frames(5);
            // The budget is looked at between uploads, so one may pass it.
            bench.Renderer.UploadMs = 1.5;
            bench.LandOn(Range(40));
            int frames = 0;
            for (; frames < 500 && bench.Stage.Status.Phase != LandingPhase.Shown; frames++)
            {
                bench.Frames(1, 4);
                Assert.LessOrEqual(bench.Stage.Stats.UpdateMs, 4 + 1.5);
            }
            Assert.AreEqual(LandingPhase.Shown, bench.Stage.Status.Phase);
            Assert.GreaterOrEqual(frames, 13, "40 uploads of 1.5 ms are more than 13 frames of 4 ms");
        }

        [Test]
        public void Image_ThatFailsAFrameLater_CountsAsMissing()
        {
            var bench = new StageBench();
            bench.Renderer.UnusableLater.Add(2);
            bench.LandOn(1, 2, 3);
            bench.Frames(60);
            Assert.IsTrue(bench.Shows(1, 3));
            Assert.AreEqual(2, bench.Renderer.Uploaded);
            Assert.AreEqual(new uint[] { 2 }, bench.Stage.Status.Missing);
        }

        [Test]
        public void Frames_WithNothingToDo_AllocateNothing()
        {
            var bench = new StageBench();
            bench.LandOn(1, 2, 3);
            bench.Frames(60);
            // Status and stats too: an interface may ask for them in every frame.
            long sum = 0;
            long allocated = Allocations.Of(100,
                () =>
                {
                    bench.Stage.Update(2);
                    sum += bench.Stage.Status.Landing + bench.Stage.Stats.InFlight;
                });
            Assert.AreEqual(120, sum);
            Assert.AreEqual(0, allocated);
        }

        [Test]
        public void Frames_WhilePayloadsAreAwaited_AllocateNothing()
        {
            var bench = new StageBench();
            bench.Frames(10);
            int landing = bench.Land();
            bench.Plan(landing, Range(20));
            bench.Arrive(landing, 0, 1, 2);
            bench.Frames(60);
            Assert.AreEqual(0, Allocations.Of(100, () => bench.Stage.Update(2)));
        }

        [Test]
        public void Budget_OfNothing_StillGetsThere()
        {
            var bench = new StageBench();
            bench.LandOn(1, 2, 3);
            // One step a frame, whatever the budget: a landing is never starved.
            bench.Frames(200, 0);
            Assert.IsTrue(bench.Shows(1, 2, 3));
        }

        [Test]
        public void Bytes_OfOneFrame_AreBounded()
        {
            var bench = new StageBench(1, options => options.MaxFrameUploadBytes = 3 * StageBench.SegmentBytes);
            bench.Frames(5);
            bench.LandOn(Range(30));
            for (int frame = 0; frame < 100; frame++)
            {
                int before = bench.Renderer.UploadCalls;
                // Time enough for all thirty: the bytes alone hold it back.
                bench.Frames(1, 1000);
                Assert.LessOrEqual(bench.Renderer.UploadCalls - before, 3);
            }
            Assert.AreEqual(30, bench.Renderer.Shown.Count);
        }

        [Test]
        public void Options_ThatBoundNothing_AreRefused()
        {
            Assert.Throws<ArgumentException>(() => new StageBench(1, options => options.MaxInFlight = 0));
            Assert.Throws<ArgumentException>(() => new StageBench(1, options => options.SpareGpuBytes = -1));
            Assert.Throws<ArgumentException>(() => new StageBench(1, options => options.BaseBlockFaces = 0));
        }

        private static uint[] Range(uint count)
        {
            var ids = new uint[count];
            for (uint at = 0; at < count; at++)
            {
                ids[at] = at;
            }
            return ids;
        }

        private static uint[] Some(Noise noise)
        {
            var ids = new HashSet<uint>();
            for (int count = 1 + noise.Below(12); count > 0; count--)
            {
                ids.Add((uint)noise.Below(StageBench.SegmentCount));
            }
            var segments = new uint[ids.Count];
            ids.CopyTo(segments);
            return segments;
        }
    }
}
