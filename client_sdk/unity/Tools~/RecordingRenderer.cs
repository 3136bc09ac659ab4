using System;
using System.Collections.Generic;
using System.Linq;

namespace Terraport.Tools
{
    /// <summary>A renderer that draws nothing: it notes what would be drawn, and every order that a real one could not carry out.</summary>
    internal sealed class RecordingRenderer : IGroundRenderer
    {
        private readonly Dictionary<ulong, MeshArrays> uploaded = new Dictionary<ulong, MeshArrays>();
        private readonly HashSet<ulong> asked = new HashSet<ulong>();
        private readonly IReadOnlyList<AttributeInfo> scales;
        private readonly bool readsImages;
        private byte[] prepared, drawnHidden = new byte[0];
        private int slices, baseSlices;

        /// <param name="scales">The scene's attributes.</param>
        /// <param name="readsImages">False: segments with images are refused, as by an engine that cannot read their format.</param>
        public RecordingRenderer(IReadOnlyList<AttributeInfo> scales, bool readsImages)
        {
            this.scales = scales;
            this.readsImages = readsImages;
        }

        /// <summary>Swaps that showed a landing.</summary>
        public int Swaps { get; private set; }

        public HashSet<ulong> Shown { get; private set; } = new HashSet<ulong>();

        public List<string> Faults { get; } = new List<string>();

        /// <summary>The base's upload does not end before this is false.</summary>
        public bool IsBaseHeld { get; set; }

        /// <summary>Segments that were uploaded and are not freed.</summary>
        public int Uploaded => uploaded.Count;

        /// <summary>Base faces that are not drawn, ascending.</summary>
        public IEnumerable<int> HiddenFaces =>
            Enumerable.Range(0, 8 * drawnHidden.Length).Where(face => (drawnHidden[face / 8] >> face % 8 & 1) != 0);

        /// <summary>What was uploaded of a segment.</summary>
        public MeshArrays Of(ulong key) { return uploaded[key]; }

        public object Prepare(SegmentMesh mesh) { return new MeshArrays(mesh, scales); }

        public object PrepareBase(SceneFiles files) { return null; }

        public void Discard(object mesh) {}

        // In three slices, as a real base takes more than one frame.
        public bool UploadBase(SceneFiles files) { return !IsBaseHeld && ++baseSlices % 3 == 0; }

        public void Upload(ulong key, object mesh)
        {
            if (!readsImages && ((MeshArrays)mesh).Uvs != null) throw new TerraportException("unsupported_image", "got an image");
            if (uploaded.ContainsKey(key)) Faults.Add("second upload of segment " + key.ToString("x16"));
            uploaded[key] = (MeshArrays)mesh;
        }

        // Not at the first question: an image that comes a frame later.
        public bool IsDrawable(ulong key)
        {
            if (!uploaded.ContainsKey(key)) Faults.Add("asked about segment " + key.ToString("x16") + ", which was not uploaded");
            return !asked.Add(key);
        }

        public void Free(ulong key)
        {
            if (Shown.Contains(key)) Faults.Add("segment " + key.ToString("x16") + " is freed and drawn");
            if (!uploaded.Remove(key)) Faults.Add("segment " + key.ToString("x16") + " is freed and was not uploaded");
            asked.Remove(key);
        }

        public bool PrepareHidden(byte[] hidden)
        {
            slices = hidden == prepared ? slices + 1 : 1;
            prepared = hidden;
            return slices >= 2;
        }

        public void Swap(bool isNewBase, HashSet<ulong> shown)
        {
            foreach (ulong key in shown.Where(key => !uploaded.ContainsKey(key)))
                Faults.Add("segment " + key.ToString("x16") + " cannot be shown");
            if (!isNewBase && slices < 2) Faults.Add("the base was not prepared");
            if (!isNewBase) Swaps++;
            drawnHidden = isNewBase ? new byte[0] : prepared;
            Shown = new HashSet<ulong>(shown);
        }
    }
}
