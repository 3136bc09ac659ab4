using System.Collections.Generic;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>Another scene version: ids mean other segments, and nothing of one version is drawn with the other's base.</summary>
    [TestFixture]
    public class SceneStageVersionTests
    {
        private const string Newer = "00000000000000000000000000000002";

        [Test]
        public void Version_ChangesInOneSwap_WhenTheNewBaseIsThere()
        {
            var bench = new StageBench();
            int landing = bench.LandOn(1, 2, 3);
            bench.Arrive(null, 20, 21);
            bench.Frames(60);
            Assert.IsTrue(bench.Shows(1, 2, 3));
            string digest = bench.Stage.VisibleDigest;
            bench.Handle(new StreamEvent { Kind = StreamEventKind.Opened, SceneVersion = Newer, IsChanged = true });
            Assert.IsTrue(bench.Stage.NeedsFiles);
            Assert.AreEqual(Newer, bench.Stage.NeededVersion);
            // The landing goes on in the new version, before its files are here.
            int pins = bench.Stream.Pins;
            bench.Plan(landing, new uint[] { 2, 30 });
            bench.Arrive(landing, 2, 30);
            bench.Ready(landing, 2, 30);
            bench.Frames(30);
            Assert.AreEqual(digest, bench.Stage.VisibleDigest, "what is shown stays until the new base is there");
            Assert.AreEqual(3, bench.Renderer.Uploaded, "of the old version all but what is shown is freed");
            Assert.AreEqual(LandingPhase.Streaming, bench.Stage.Status.Phase);
            Assert.AreEqual(pins, bench.Stream.Pins, "payloads wait for the manifest by which they are decoded");

            bench.Stage.ReplaceFiles(StageBench.FilesOf("00000000000000000000000000000003", 5));
            Assert.IsTrue(bench.Stage.NeedsFiles, "files of a version that is not open are not taken");
            SceneFiles files = StageBench.FilesOf(Newer, 9);
            bench.Stage.ReplaceFiles(files);
            bench.Cover = files.Cover;
            Assert.IsFalse(bench.Stage.NeedsFiles);
            bench.Frames(60);
            List<SceneSwap> swaps = bench.Renderer.Swaps;
            Assert.AreEqual(4, swaps.Count);
            Assert.IsTrue(swaps[2].IsNewBase);
            Assert.AreEqual(new uint[] { 1, 2, 3 }, swaps[2].Hidden);
            Assert.IsTrue(bench.Shows(2, 30));
            Assert.AreEqual(2, bench.Renderer.Uploaded);
        }

        [Test]
        public void Version_OpenedBeforeItsFilesWereLoaded_IsNoticedAtOnce()
        {
            var bench = new StageBench();
            bench.Handle(new StreamEvent { Kind = StreamEventKind.Opened, SceneVersion = Newer, IsChanged = false });
            Assert.IsTrue(bench.Stage.NeedsFiles);
            bench.Frames(10);
            Assert.AreEqual(0, bench.Renderer.Swaps.Count);
        }

        [Test]
        public void Version_ThatIsTheFilesOwn_ChangesNothing()
        {
            var bench = new StageBench();
            bench.LandOn(1);
            bench.Frames(60);
            string version = bench.Stage.Files.Manifest.Version;
            bench.Handle(new StreamEvent { Kind = StreamEventKind.Opened, SceneVersion = version, IsChanged = false });
            bench.Frames(10);
            Assert.IsFalse(bench.Stage.NeedsFiles);
            Assert.IsTrue(bench.Shows(1));
            Assert.AreEqual(2, bench.Renderer.Swaps.Count);
        }
    }
}
