using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>One payload to be decoded.</summary>
    internal struct DecodeJob
    {
        /// <summary>Segment id.</summary>
        internal uint Segment;
        /// <summary>The stage's number of the scene version that asked: results of an earlier one are dropped.</summary>
        internal int Epoch;
        /// <summary>Those of the scene version that asked.</summary>
        internal IReadOnlyList<AttributeInfo> Attributes;
        /// <summary>Owned by the job; released by <see cref="Run"/>, or by its queue where that is disposed of first.</summary>
        internal PinnedPayload Payload;

        /// <summary>
        /// Decode it, and let the payload go. Whatever goes wrong belongs to this segment alone, and is told as its
        /// error.
        /// </summary>
        internal DecodeResult Run(SegmentDecoder decoder, MeshPool pool, Action<SegmentMesh> afterDecode)
        {
            // From here on the mesh belongs to this job, and in the end to the result or to the pool again.
            SegmentMesh mesh = pool.Rent();
            var result = new DecodeResult { Segment = Segment, Epoch = Epoch };
            try
            {
                decoder.Decode(Payload.Bytes, Attributes, mesh);
                if (afterDecode != null)
                {
                    afterDecode(mesh);
                }
                result.Mesh = mesh;
            }
            catch (TerraportException error)
            {
                result.Error = error;
            }
            catch (Exception error)
            {
                // A mistake of ours, or of the engine's hook, or no memory: a thread must not die of it.
                result.Error = new TerraportException("internal", "segment " + Segment + ": " + error.Message, null, error);
            }
            finally
            {
                Payload.Dispose();
                if (result.Mesh == null)
                {
                    pool.Return(mesh);
                }
            }
            return result;
        }
    }
}
