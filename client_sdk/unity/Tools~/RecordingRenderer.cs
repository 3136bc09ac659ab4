using System;
using System.Collections.Generic;

namespace Terraport.Tools
{
    /// <summary>
    /// A renderer that draws nothing: it notes what would be drawn, and every order that a real one could not keep (a segment
    /// shown that was never uploaded, a block of the base changed that was not prepared, ...).
    /// </summary>
    internal sealed class RecordingRenderer : ISceneRenderer
    {
        /// <summary>How often each uploaded segment was asked whether it can be drawn.</summary>
        private readonly Dictionary<uint, int> uploaded = new Dictionary<uint, int>();
        private readonly HashSet<uint> begun = new HashSet<uint>();
        private readonly SortedSet<uint> shown = new SortedSet<uint>();
        private readonly Dictionary<int, byte[]> prepared = new Dictionary<int, byte[]>();
        private readonly List<string> faults = new List<string>();
        private byte[] coming;
        private byte[] drawn = new byte[0];
        private SceneFiles uploadedBase;

        /// <summary>Swaps that showed or hid a segment.</summary>
        public int Swaps { get; private set; }

        public IEnumerable<uint> Shown => shown;

        /// <summary>Orders that could not be kept.</summary>
        public IList<string> Faults => faults;

        /// <summary>Base faces that are not drawn, ascending: as the prepared blocks say, not as the stage says.</summary>
        public IEnumerable<uint> HiddenFaces
        {
            get {
                for (int face = 0; face < drawn.Length; face++)
                {
                    if (drawn[face] != 0) yield return (uint)face;
                }
            }
        }

        public bool UploadBase(SceneFiles files)
        {
            // In two calls, as a real base takes more than one frame.
            bool isFinished = uploadedBase == files;
            uploadedBase = files;
            coming = new byte[files.Base.FaceCount];
            return isFinished;
        }

        public void PrepareBase(FaceRange block, HiddenFaces next)
        {
            if (block.End > next.Mask.Length)
            {
                faults.Add("a block beyond the base's faces");
                return;
            }
            var faces = new byte[block.Count];
            Array.Copy(next.Mask, block.First, faces, 0, block.Count);
            prepared[block.First] = faces;
        }

        public bool Upload(uint segment, SegmentMesh mesh)
        {
            if (mesh.VertexCount == 0 || mesh.FaceCount == 0) faults.Add("upload of an empty segment " + segment);
            if (uploaded.ContainsKey(segment)) faults.Add("second upload of segment " + segment);
            // Every other segment in two slices, as one with an image.
            if (segment % 2 == 1 && begun.Add(segment)) return false;
            begun.Remove(segment);
            uploaded[segment] = 0;
            return true;
        }

        public bool IsDrawable(uint segment)
        {
            int queries;
            if (!uploaded.TryGetValue(segment, out queries))
            {
                faults.Add("segment " + segment + " is asked about and was not uploaded");
                return false;
            }
            uploaded[segment] = ++queries;
            // Not at the first question: an image that comes a frame later.
            return queries > 1;
        }

        public void Free(uint segment)
        {
            begun.Remove(segment);
            uploaded.Remove(segment);
            if (shown.Contains(segment)) faults.Add("segment " + segment + " is freed and drawn");
        }

        public void Swap(SceneSwap swap)
        {
            if (swap.Shown.Count + swap.Hidden.Count > 0) Swaps++;
            if (swap.IsNewBase)
            {
                if (coming == null) faults.Add("a new base that was not uploaded");
                drawn = coming ?? drawn;
            }
            foreach (uint segment in swap.Shown)
            {
                int queries;
                if (!uploaded.TryGetValue(segment, out queries) || queries < 2)
                    faults.Add("segment " + segment + " is shown and cannot be drawn");
                if (!shown.Add(segment)) faults.Add("segment " + segment + " is shown twice");
            }
            foreach (uint segment in swap.Hidden)
            {
                if (!shown.Remove(segment)) faults.Add("segment " + segment + " is hidden and was not shown");
            }
            foreach (FaceRange block in swap.ChangedBlocks)
            {
                byte[] faces;
                if (prepared.TryGetValue(block.First, out faces) && faces.Length == block.Count)
                    faces.CopyTo(drawn, block.First);
                else
                    faults.Add("block " + block.First + " of the base was not prepared");
            }
            // The prepared lists, put together, must hide what the stage says that it hides.
            for (int face = 0; face < drawn.Length; face++)
            {
                if (drawn[face] == swap.BaseHidden.Mask[face]) continue;
                faults.Add("the prepared blocks of the base are not what the swap says");
                break;
            }
        }
    }
}
