using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.IO;
using Terraport.Json;

namespace Terraport.Tools
{
    /// <summary>
    /// How fast payloads are decoded, and how much is allocated for one. The file holds the scene's attributes, as its manifest lists them,
    /// and payloads, each after its length (uint32, little-endian).
    /// </summary>
    internal static class DecodeBenchmark
    {
        /// <summary>Rounds over all payloads before anything is measured: buffers grow, code is compiled.</summary>
        private const int WarmUpRounds = 2;

        public static int Run(string path, double seconds)
        {
            var decoder = new SegmentDecoder();
            List<byte[]> payloads = ReadRecords(path);
            IReadOnlyList<AttributeInfo> attributes = ManifestReader.ReadAttributes(JsonReader.Read(new ArraySegment<byte>(payloads[0])));
            payloads.RemoveAt(0);
            var mesh = new SegmentMesh();
            long bytes = 0;
            long faces = 0;
            // 1. Warm up; count bytes and faces of one round on the way.
            for (int round = 0; round < WarmUpRounds; round++)
            {
                bytes = 0;
                faces = 0;
                foreach (byte[] payload in payloads)
                {
                    decoder.Decode(new ArraySegment<byte>(payload), attributes, mesh);
                    bytes += payload.Length;
                    faces += mesh.FaceCount;
                }
            }
            // 2. Measure whole rounds until the time is over.
            // Objects that the measurement itself needs are made before: whatever is allocated from here on is the decoder's.
            var watch = new Stopwatch();
            int rounds = 0;
            long seen = MeterSees();
            watch.Start();
            double elapsed = watch.Elapsed.TotalSeconds;
            long before = GC.GetAllocatedBytesForCurrentThread();
            do
            {
                for (int at = 0; at < payloads.Count; at++) decoder.Decode(new ArraySegment<byte>(payloads[at]), attributes, mesh);
                rounds++;
                elapsed = watch.Elapsed.TotalSeconds;
            }
            while (elapsed < seconds);
            // 3. Report.
            long allocated = GC.GetAllocatedBytesForCurrentThread() - before;
            long decoded = (long)rounds * payloads.Count;
            var json = new JsonText();
            json.Open('{').Key("segments").Value(decoded).Key("seconds").Value(elapsed);
            json.Key("segments_per_s").Value(decoded / elapsed);
            json.Key("payload_mb_per_s").Value(rounds * (bytes / 1e6) / elapsed);
            json.Key("mtriangles_per_s").Value(rounds * (faces / 1e6) / elapsed);
            json.Key("allocated_bytes").Value(allocated);
            json.Key("meter_saw_bytes").Value(seen);
            json.Key("allocated_bytes_per_segment").Value(allocated / (double)decoded);
            Console.WriteLine(json.Close('}'));
            return 0;
        }

        /// <summary>What the meter says of a kilobyte and more in small objects: one that stands still proves nothing.</summary>
        private static long MeterSees()
        {
            long before = GC.GetAllocatedBytesForCurrentThread();
            var kept = new object[64];
            for (int at = 0; at < kept.Length; at++) kept[at] = new byte[16];
            long after = GC.GetAllocatedBytesForCurrentThread();
            GC.KeepAlive(kept);
            return after - before;
        }

        private static List<byte[]> ReadRecords(string path)
        {
            var records = new List<byte[]>();
            using (var reader = new BinaryReader(File.OpenRead(path)))
            {
                while (reader.BaseStream.Position < reader.BaseStream.Length) records.Add(reader.ReadBytes((int)reader.ReadUInt32()));
            }
            return records;
        }
    }
}
