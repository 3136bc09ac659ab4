using System.Collections.Generic;

namespace Terraport
{
    /// <summary>Meshes whose buffers serve one payload after the other. For any thread.</summary>
    internal sealed class MeshPool
    {
        /// <summary>As many as a stage has in flight, and some; one more is left to the garbage collector.</summary>
        private const int MaxSpares = 32;
        private readonly Stack<SegmentMesh> spare = new Stack<SegmentMesh>();

        internal SegmentMesh Take()
        {
            lock (spare) { return spare.Count > 0 ? spare.Pop() : new SegmentMesh(); }
        }

        internal void Give(SegmentMesh mesh)
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
