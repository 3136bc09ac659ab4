using System;
using System.Collections.Generic;
using System.IO;
using System.Text;

namespace Terraport.Tests
{
    /// <summary>A stage over a made-up scene: a fake stream, a recording renderer, one payload for every segment.</summary>
    internal sealed class StageBench
    {
        internal const int SegmentCount = 60;
        internal const int FaceCount = 500;
        // One payload for all: what a segment looks like does not matter to the stage.
        private static readonly CorpusPayload Segment = new CorpusPayload("good-attribute.tsg");
        private static readonly byte[] Payload = Segment.Bytes;

        internal readonly FakeStream Stream = new FakeStream();
        internal readonly RecordingRenderer Renderer = new RecordingRenderer();
        internal readonly InlineDecodes Decoders = new InlineDecodes();
        internal readonly StageOptions Options;
        internal readonly SceneStage Stage;
        internal Cover Cover;

        internal StageBench(uint seed = 1, Action<StageOptions> change = null, int levels = 1)
        {
            Options = new StageOptions { BaseBlockFaces = 16, ClockMs = () => Renderer.NowMs };
            if (change != null)
            {
                change(Options);
            }
            SceneFiles files = FilesOf("00000000000000000000000000000001", seed, levels);
            Cover = files.Cover;
            Stage = new SceneStage(Stream, files, Renderer, Decoders, Options);
        }

        /// <summary>GPU bytes of one segment.</summary>
        internal static long SegmentBytes
        {
            get {
                var mesh = new SegmentMesh();
                Segment.Decode(new ArraySegment<byte>(Payload), mesh);
                return mesh.GpuBytes;
            }
        }

        /// <summary>Files of a version, its cover made up.</summary>
        internal static SceneFiles FilesOf(string version, uint seed, int levels = 1)
        {
            string text = File.ReadAllText(Repository.PathTo("tests/conformance/scene/tiny/scene.json"));
            SceneManifest manifest = ManifestReader.Read(new ArraySegment<byte>(Encoding.UTF8.GetBytes(text)), "tiny");
            // The manifest's own constructor is internal to the reader: another version is made by its text.
            text = text.Replace(manifest.Version, version).Replace("\"segments\": 4", "\"segments\": " + SegmentCount);
            text = text.Replace("\"counts\":", "\"levels\": " + levels + ", \"counts\":");
            manifest = ManifestReader.Read(new ArraySegment<byte>(Encoding.UTF8.GetBytes(text)), "tiny");
            Cover cover = Covers.Random(new Noise(seed), FaceCount, SegmentCount);
            return new SceneFiles(manifest, new SegmentMesh(), cover, new RegionFacts[0], new RegionUnion[0]);
        }

        internal static SegmentFacts Facts(uint segment) { return new SegmentFacts(segment, Payload.Length, 1, 8, 9, default(Box)); }

        internal void Handle(StreamEvent next) { Stage.Handle(ref next); }

        internal int Land() { return Stage.Land(new Vec3(1, 2, 3), 40); }

        internal void Plan(int landing, uint[] load, uint[] keep = null, uint[] nearby = null)
        {
            SegmentFacts[] rows = Array.ConvertAll(load, Facts);
            var plan = new PlanFacts {
                Landing = landing,
                Load = rows,
                Keep = keep ?? new uint[0],
                Nearby = nearby ?? new uint[0],
            };
            Handle(new StreamEvent { Kind = StreamEventKind.Planned, Landing = landing, Plan = plan });
        }

        /// <summary>Payloads came; for an aim where the landing is null.</summary>
        internal void Arrive(int? landing, params uint[] segments)
        {
            foreach (uint segment in segments)
            {
                Stream.Hold(segment, Payload);
                Handle(new StreamEvent { Kind = StreamEventKind.Arrived, Landing = landing, Facts = Facts(segment) });
            }
        }

        internal void Ready(int landing, params uint[] visible)
        {
            var sorted = (uint[])visible.Clone();
            Array.Sort(sorted);
            Handle(new StreamEvent { Kind = StreamEventKind.Ready, Landing = landing, Segments = sorted, Missing = new uint[0],
                ElapsedMs = 5 });
        }

        internal void Degrade(int landing, params uint[] segments)
        {
            Handle(new StreamEvent { Kind = StreamEventKind.Degraded, Landing = landing, Segments = segments });
        }

        /// <summary>A whole landing: command, plan, payloads, ready.</summary>
        internal int LandOn(params uint[] segments)
        {
            int landing = Land();
            Plan(landing, segments);
            Arrive(landing, segments);
            Ready(landing, segments);
            return landing;
        }

        internal void Frames(int count, double budgetMs = 2)
        {
            for (int frame = 0; frame < count; frame++)
            {
                Stage.Update(budgetMs);
            }
        }

        /// <summary>Whether exactly these are shown, and the base hides what brute force says.</summary>
        internal bool Shows(params uint[] segments)
        {
            // A cover names segments, whichever level of them is shown.
            var covering = new HashSet<uint>(Array.ConvertAll(segments, id => id % SegmentCount));
            return Renderer.Shown.SetEquals(segments) && Covers.IsSame(Renderer.Drawn, Covers.Hidden(Cover, covering));
        }
    }
}
