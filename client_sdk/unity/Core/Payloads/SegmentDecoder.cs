using System;

namespace Terraport
{
    /// <summary>Segments' payloads to meshes. One decoder serves one thread.</summary>
    public sealed class SegmentDecoder
    {
        /// <summary>In which form payloads are asked for, and how their files end: the one that is decoded here.</summary>
        public const string Encoding = "glb";

        private readonly GlbDecoder glb = new GlbDecoder();

        /// <summary>Decode a segment's payload. The bytes are only read, and nothing of them is kept.</summary>
        /// <exception cref="PayloadException">For anything that is not a whole payload: never another exception.</exception>
        public void Decode(ArraySegment<byte> payload, SegmentMesh into) { glb.Decode(payload, false, into); }
    }
}
