using System.Collections.Generic;

namespace Terraport
{
    /// <summary>Meshes whose buffers serve one payload after the other. For any thread.</summary>
    internal sealed class MeshPool
    {
        /// <summary>As many as a stage has in flight, and some; one more is left to the garbage collector.</summary>
        private const int MaxSpares = 32;
        private readonly Stack<SegmentMesh> spare = new Stack<SegmentMesh>();

        /// <summary>A mesh with the buffers of an earlier payload, or a new one; the caller owns it.</summary>
        internal SegmentMesh Rent()
        {
            lock (spare) { return spare.Count > 0 ? spare.Pop() : new SegmentMesh(); }
        }

        /// <summary>Take a mesh back that nobody uses any more.</summary>
        internal void Return(SegmentMesh mesh)
        {
            lock (spare)
            {
                if (spare.Count < MaxSpares)
                {
                    spare.Push(mesh);
                }
            }
        }
    }
}
