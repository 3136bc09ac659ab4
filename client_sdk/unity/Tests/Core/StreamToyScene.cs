using System;
using System.Collections.Generic;
using System.Linq;

namespace Terraport.Tests
{
    /// <summary>
    /// A scene small enough to check by brute force: Grid x Grid segments in the plane y = 0, boxes of 1 m with gaps of 1 m;
    /// segment i is at (2 * (i % Grid), 0, 2 * (i / Grid)).
    /// </summary>
    internal sealed class StreamToyScene
    {
        internal const int Grid = 6;
        internal const int FacesEach = 10;
        internal static readonly Vec3 Middle = new Vec3(Grid, 0, Grid);

        internal readonly string Version;
        internal readonly byte[][] Payloads = new byte[Grid * Grid][];
        internal readonly SegmentFacts[] Facts = new SegmentFacts[Grid * Grid];

        internal StreamToyScene(int seed = 0, string version = "v1", int maxBytes = 900)
        {
            Version = version;
            var random = new Random(seed);
            for (uint segment = 0; segment < Payloads.Length; segment++)
            {
                var payload = new byte[1 + random.Next(maxBytes)];
                random.NextBytes(payload);
                Replace(segment, payload);
            }
        }

        internal void Replace(uint segment, byte[] payload)
        {
            float x = 2 * (segment % Grid);
            float z = 2 * (segment / Grid);
            Payloads[segment] = payload;
            Facts[segment] = new SegmentFacts(
                segment, payload.Length, Xxh3.Hash64(payload, 0, payload.Length), FacesEach, 12, new Box(x, 0, z, x + 1, 0, z + 1));
        }

        /// <summary>Brute force: ids of the segments that a landing shows, ascending.</summary>
        internal uint[] Within(Vec3 centre, double radiusM)
        {
            return Facts.Where(facts => facts.Bounds.DistanceM(centre) <= radiusM).Select(facts => facts.Segment).ToArray();
        }

        internal long BytesOf(IEnumerable<uint> segments) { return segments.Sum(segment => (long)Payloads[segment].Length); }
    }
}
