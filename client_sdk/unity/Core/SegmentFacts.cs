namespace Terraport
{
    /// <summary>What the scene's index says of one segment: a row of a load table.</summary>
    public readonly struct SegmentFacts
    {
        /// <summary>Segment id: row of the scene version's index.</summary>
        public readonly uint Segment;

        /// <summary>Payload bytes.</summary>
        public readonly int Length;

        /// <summary>XXH3-64 of the payload, seed 0.</summary>
        public readonly ulong Xxh3;

        /// <summary>Triangles.</summary>
        public readonly uint Faces;

        /// <summary>Vertices.</summary>
        public readonly uint Vertices;

        /// <summary>Box of the decoded positions, metres, scene frame.</summary>
        public readonly Box Bounds;

        /// <summary>A row of the index.</summary>
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
