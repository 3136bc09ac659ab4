using System;

namespace Terraport
{
    /// <summary>Payloads of one encoding to meshes. One decoder serves one thread.</summary>
    public sealed class SegmentDecoder
    {
        private readonly GlbDecoder glb;
        private readonly ArraysDecoder arrays;

        /// <summary>A decoder with no scratch memory yet.</summary>
        public SegmentDecoder(PayloadEncoding encoding)
        {
            Encoding = encoding;
            if (encoding == PayloadEncoding.Glb)
            {
                glb = new GlbDecoder();
            }
            else
            {
                arrays = new ArraysDecoder();
            }
        }

        /// <summary>Which payloads it decodes.</summary>
        public PayloadEncoding Encoding { get; private set; }

        /// <summary>Decode a segment's payload. The bytes are only read, and nothing of them is kept.</summary>
        /// <exception cref="PayloadException">For anything that is not a whole payload: never another exception.</exception>
        public void Decode(ArraySegment<byte> payload, SegmentMesh into)
        {
            if (glb != null)
            {
                glb.Decode(payload, false, into);
            }
            else
            {
                arrays.Decode(payload, into);
            }
        }
    }
}
