using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// Turns payloads into meshes, on threads of its own or in slices of a frame. All calls come from one thread.
    /// </summary>
    public interface IDecodeQueue : IDisposable
    {
        /// <summary>Decode a payload of a scene with these attributes; it is disposed of when that is done, on whatever thread.</summary>
        void Enqueue(uint segment, int epoch, IReadOnlyList<AttributeInfo> attributes, PinnedPayload payload);

        /// <summary>Take a finished one; false where none is.</summary>
        bool TryTake(out DecodeResult result);

        /// <summary>Do a slice of work on this thread; false where there is none, or where threads do it.</summary>
        bool Step();

        /// <summary>Give a mesh back, so that its buffers serve another payload.</summary>
        void Recycle(SegmentMesh mesh);
    }
}
