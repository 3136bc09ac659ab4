using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>The way of segments from the stream through the decoders to the renderer, one slice at a time.</summary>
    internal sealed class StageUploads
    {
        private readonly Residency residency;
        private readonly ISceneStream stream;
        private readonly ISceneRenderer renderer;
        private readonly IDecodeQueue decoders;
        private readonly Action<uint, TerraportException> onFailed;
        // Decoded meshes that wait for their upload; owned here until they go back to the decoders.
        private readonly Dictionary<uint, SegmentMesh> waiting = new Dictionary<uint, SegmentMesh>();
        /// <summary>Segments of this version that the renderer was given, and did not free.</summary>
        private readonly HashSet<uint> uploaded = new HashSet<uint>();
        // Uploaded, and not drawable at once yet: a texture may be decoded a frame or more later.
        private readonly List<uint> warming = new List<uint>();
        private readonly List<uint> freed = new List<uint>();
        /// <summary>Segments whose upload goes on in the next frame.</summary>
        private readonly HashSet<uint> paused = new HashSet<uint>();

        internal StageUploads(Residency residency, ISceneStream stream, ISceneRenderer renderer, IDecodeQueue decoders,
            Action<uint, TerraportException> onFailed)
        {
            this.residency = residency;
            this.stream = stream;
            this.renderer = renderer;
            this.decoders = decoders;
            this.onFailed = onFailed;
        }

        /// <summary>The scene's, by which payloads are decoded; null while the files of their version are not here: they wait.</summary>
        internal IReadOnlyList<AttributeInfo> Attributes { get; set; }

        /// <summary>Segments that the renderer has, in whole or in part.</summary>
        internal int Count => uploaded.Count;

        /// <summary>Ask for decodes, note what became drawable, and what is to be freed.</summary>
        internal void BeginFrame()
        {
            paused.Clear();
            AskForDecodes();
            EndWarming();
            residency.TakeFreed(freed);
        }

        /// <summary>Give the decoders what they have room for.</summary>
        internal void AskForDecodes()
        {
            uint segment;
            while (Attributes != null && residency.TryTakeDecode(out segment))
            {
                PinnedPayload payload;
                // Pinned until it is decoded: the cache may let go of the segment meanwhile.
                if (stream.TryPin(segment, out payload))
                {
                    decoders.Enqueue(segment, residency.Epoch, Attributes, payload);
                }
                else
                {
                    residency.Failed(segment, residency.Epoch);
                }
            }
        }

        /// <summary>Free a segment that nobody needs. Comes before any other slice: its id may be on its way again.</summary>
        internal long FreeNext()
        {
            if (freed.Count == 0)
            {
                return 0;
            }
            Free(freed[freed.Count - 1]);
            freed.RemoveAt(freed.Count - 1);
            return 1;
        }

        /// <summary>Take a mesh, or a failure, from the decoders.</summary>
        internal long TakeDecoded()
        {
            DecodeResult result;
            if (!decoders.TryTake(out result))
            {
                return 0;
            }
            if (result.Mesh == null)
            {
                residency.Failed(result.Segment, result.Epoch);
                // A failure of an older version concerns nobody.
                if (result.Epoch == residency.Epoch)
                {
                    onFailed(result.Segment, result.Error);
                }
            }
            else if (residency.Decoded(result.Segment, result.Epoch, result.Mesh.GpuBytes))
            {
                waiting.Add(result.Segment, result.Mesh);
            }
            else
            {
                decoders.Recycle(result.Mesh);
            }
            return 1;
        }

        /// <summary>Hand the most urgent mesh to the renderer: its GPU bytes the first time.</summary>
        internal long UploadNext()
        {
            uint segment;
            if (!residency.TryNextUpload(waiting, paused, out segment))
            {
                return 0;
            }
            SegmentMesh mesh = waiting[segment];
            // A call for what is left of a paused upload counts as next to nothing.
            long bytes = uploaded.Add(segment) ? mesh.GpuBytes : 1;
            try
            {
                if (!renderer.Upload(segment, mesh))
                {
                    paused.Add(segment);
                    return bytes;
                }
            }
            // Of this segment alone: its base stays, and the landing goes on without it.
            catch (TerraportException error)
            {
                Free(segment);
                residency.Failed(segment, residency.Epoch);
                onFailed(segment, error);
                return bytes;
            }
            waiting.Remove(segment);
            decoders.Recycle(mesh);
            residency.Uploaded(segment);
            warming.Add(segment);
            return bytes;
        }

        /// <summary>A decode on this thread, where the queue has no threads.</summary>
        internal long DecodeNext() { return decoders.Step() ? 1 : 0; }

        /// <summary>
        /// Let go of all that waits, and of all that the renderer has but what is shown: of that <see cref="FreeShown"/>.
        /// </summary>
        internal void FreeAllButShown()
        {
            foreach (KeyValuePair<uint, SegmentMesh> pair in waiting)
            {
                decoders.Recycle(pair.Value);
            }
            waiting.Clear();
            foreach (uint segment in uploaded)
            {
                // Visible ascends.
                if (Array.BinarySearch(residency.Visible, segment) < 0)
                {
                    renderer.Free(segment);
                }
            }
            uploaded.Clear();
            warming.Clear();
            freed.Clear();
        }

        /// <summary>Let go of what was shown, and is not any more.</summary>
        internal void FreeShown(uint[] segments)
        {
            foreach (uint segment in segments)
            {
                renderer.Free(segment);
            }
        }

        private void EndWarming()
        {
            for (int at = warming.Count - 1; at >= 0; at--)
            {
                if (!uploaded.Contains(warming[at]) || HasWarmed(warming[at]))
                {
                    // Order does not matter here: the last takes the free slot.
                    warming[at] = warming[warming.Count - 1];
                    warming.RemoveAt(warming.Count - 1);
                }
            }
        }

        /// <summary>Whether a segment needs no further preparation, or can have none.</summary>
        private bool HasWarmed(uint segment)
        {
            try
            {
                if (!renderer.IsDrawable(segment))
                {
                    return false;
                }
                residency.Warmed(segment);
            }
            catch (TerraportException error)
            {
                Free(segment);
                residency.Failed(segment, residency.Epoch);
                onFailed(segment, error);
            }
            return true;
        }

        /// <summary>The mesh that waits, and what the renderer has of it.</summary>
        private void Free(uint segment)
        {
            SegmentMesh mesh;
            if (waiting.TryGetValue(segment, out mesh))
            {
                waiting.Remove(segment);
                decoders.Recycle(mesh);
            }
            if (uploaded.Remove(segment))
            {
                renderer.Free(segment);
            }
        }
    }
}
