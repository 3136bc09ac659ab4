namespace Terraport
{
    /// <summary>What the scene's index says of one segment: a row of a load table.</summary>
    public readonly struct SegmentFacts
    {
        /// <summary>Segment id: row of the scene version's index.</summary>
        public readonly uint Segment;

        /// <summary>Length of the payload, bytes.</summary>
        public readonly int Length;

        /// <summary>XXH3-64 of the payload, seed 0.</summary>
        public readonly ulong Xxh3;

        /// <summary>Triangles of the segment.</summary>
        public readonly uint Faces;

        /// <summary>Vertices of the segment.</summary>
        public readonly uint Vertices;

        /// <summary>Box of the decoded positions, metres, scene frame.</summary>
        public readonly Box Bounds;

        /// <summary>A row of the index; the numbers are taken as they are, the wire's kinds check them.</summary>
        public SegmentFacts(uint segment, int length, ulong xxh3, uint faces, uint vertices, Box bounds)
        {
            Segment = segment;
            Length = length;
            Xxh3 = xxh3;
            Faces = faces;
            Vertices = vertices;
            Bounds = bounds;
        }
    }
}
