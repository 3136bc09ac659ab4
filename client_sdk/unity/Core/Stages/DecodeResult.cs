namespace Terraport
{
    /// <summary>What became of one payload: a mesh or an error.</summary>
    public struct DecodeResult
    {
        /// <summary>Segment id.</summary>
        public uint Segment;

        /// <summary>As it was given to <see cref="IDecodeQueue.Enqueue"/>.</summary>
        public int Epoch;

        /// <summary>The mesh, to be given back by <see cref="IDecodeQueue.Recycle"/>; null where it failed.</summary>
        public SegmentMesh Mesh;

        /// <summary>Why it failed; else null.</summary>
        public TerraportException Error;
    }
}
