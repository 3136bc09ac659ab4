using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.IO;
using System.Linq;
using Terraport.Unity;

namespace Terraport.Tools
{
    /// <summary>Measures how fast payloads are decoded and packed, and how much is allocated for one.</summary>
    internal static class DecodeBenchmark
    {
        /// <param name="seconds">How long.</param>
        /// <param name="attributeCount">Attributes of the scene.</param>
        /// <param name="paths">Files of payloads, without images.</param>
        public static int Run(double seconds, int attributeCount, string[] paths)
        {
            List<ArraySegment<byte>> payloads = paths.Select(path => new ArraySegment<byte>(File.ReadAllBytes(path))).ToList();
            var decoder = new SegmentDecoder();
            var mesh = new SegmentMesh();
            var packed = new PackedMesh();
            long faces = 0, segments = 0, bytes = 0, before = 0;
            Stopwatch watch = Stopwatch.StartNew();
            // Two rounds first, in which buffers grow and code is compiled.
            for (int round = 0; round < 2 || watch.Elapsed.TotalSeconds < seconds; round++)
            {
                if (round == 2)
                {
                    watch.Restart();
                    faces = segments = bytes = 0;
                    before = GC.GetAllocatedBytesForCurrentThread();
                }
                for (int at = 0; at < payloads.Count; at++)
                {
                    decoder.Decode(payloads[at], attributeCount, mesh);
                    packed.Pack(mesh);
                    faces += mesh.FaceCount;
                    bytes += payloads[at].Count;
                    segments++;
                }
            }
            double elapsedS = watch.Elapsed.TotalSeconds;
            long allocated = GC.GetAllocatedBytesForCurrentThread() - before;
            Console.WriteLine(Canonical.Text(new Dictionary<string, object> {
                { "segments", segments },
                { "segments_per_s", segments / elapsedS },
                { "payload_mb_per_s", bytes / 1e6 / elapsedS },
                { "mtriangles_per_s", faces / 1e6 / elapsedS },
                { "allocated_bytes_per_segment", (double)allocated / segments },
            }));
            return 0;
        }
    }
}
