using System;

namespace Terraport
{
    /// <summary>Reads base.cover (scene format, section 8); every truncation and flipped bit is noticed.</summary>
    public static class CoverReader
    {
        private const string Magic = "TPCOVER1";

        /// <summary>Read the cover of a base; the arrays are copies.</summary>
        /// <param name="file">The whole file.</param>
        /// <param name="baseFaces">Faces of the base mesh: the cover has one row for each.</param>
        /// <param name="segmentCount">Segments of the scene: ids are below it.</param>
        /// <exception cref="PayloadException">Damaged, of another base or scene, or with ids out of range or order.</exception>
        public static Cover Read(ArraySegment<byte> file, int baseFaces, int segmentCount)
        {
            var flat = new FlatFile();
            flat.Read(file, Magic);
            uint[] offsets = Column(flat, "offsets");
            uint[] segments = Column(flat, "segments");
            if (flat.Rows != (uint)baseFaces || offsets.Length != baseFaces + 1L)
            {
                throw new PayloadException("cover of " + flat.Rows + " rows, expected " + baseFaces + ": one a base face");
            }
            if (offsets[0] != 0 || offsets[baseFaces] != (uint)segments.Length)
            {
                string run = offsets[0] + " to " + offsets[baseFaces];
                throw new PayloadException("cover offsets run " + run + ", expected 0 to " + segments.Length);
            }
            // All of them before any row is read: until then an offset may point anywhere.
            for (int face = 0; face < baseFaces; face++)
            {
                if (offsets[face + 1] < offsets[face])
                {
                    throw new PayloadException("cover offsets decrease at base face " + face + ", expected ascending");
                }
            }
            CheckRows(offsets, segments, segmentCount);
            return new Cover(offsets, segments);
        }

        private static uint[] Column(FlatFile flat, string name)
        {
            int field = flat.Find(name);
            var values = new uint[flat.RowsOf(field, name, FlatFile.ElementType.UInt32, 1)];
            flat.CopyTo(field, values);
            return values;
        }

        private static void CheckRows(uint[] offsets, uint[] segments, int segmentCount)
        {
            for (int face = 0; face + 1 < offsets.Length; face++)
            {
                for (uint at = offsets[face]; at < offsets[face + 1]; at++)
                {
                    if (segments[at] >= (uint)segmentCount)
                    {
                        throw new PayloadException("segment " + segments[at] + " in the cover, expected below " + segmentCount);
                    }
                    // Ascending: the counters count each segment once, and every client compares rows by value.
                    if (at > offsets[face] && segments[at] <= segments[at - 1])
                    {
                        throw new PayloadException("segments over base face " + face + " do not ascend, expected each once, ascending");
                    }
                }
            }
        }
    }
}
