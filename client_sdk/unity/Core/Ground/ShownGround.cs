using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// Knows the ground that a renderer shows, for rays and feet: stands between a <see cref="SceneStage"/> and its renderer. Detail
    /// where it is shown, the base elsewhere, no hidden face of it; it changes with the swap and with nothing else.
    /// </summary>
    public sealed class ShownGround : ISceneRenderer
    {
        // A ray that meets nothing sooner: farther than any scene.
        private const double FarM = 1e8;

        private readonly ISceneRenderer renderer;
        // As the renderer has them. Bounded as these are: 24 bytes a face or so beside what is on the graphics card.
        private readonly Dictionary<uint, GroundMesh> meshes = new Dictionary<uint, GroundMesh>();
        private readonly Dictionary<uint, GroundMesh> shown = new Dictionary<uint, GroundMesh>();
        // Made ahead on another thread, by Prepare.
        private volatile Prepared prepared;
        private SceneFiles comingFiles;
        private GroundMesh coming;
        private GroundMesh drawn;
        // Of the drawn base: ids from here on are those of the coarser level.
        private uint segmentCount = uint.MaxValue;
        private byte[] hidden = Array.Empty<byte>();

        /// <summary>Know what <paramref name="renderer"/> shows from now on.</summary>
        public ShownGround(ISceneRenderer renderer)
        {
            if (renderer == null) throw new ArgumentNullException("renderer");
            this.renderer = renderer;
        }

        /// <summary>Make the base of files ready for rays, on any thread, before the stage has them: for a large one it takes longer than a frame.</summary>
        public void Prepare(SceneFiles files) { prepared = new Prepared(files, new GroundMesh(files.Base)); }

        /// <summary>The first point of a ray of what is shown; false where there is none.</summary>
        /// <param name="origin">Metres, scene frame.</param>
        /// <param name="direction">Of any length but 0; the point's At counts in it.</param>
        /// <param name="mostAt">How far, in lengths of the direction.</param>
        /// <param name="point">What was met.</param>
        public bool Cast(Vec3 origin, Vec3 direction, double mostAt, out GroundPoint point)
        {
            point = new GroundPoint { At = mostAt };
            bool isMet = drawn != null && drawn.Cast(origin, direction, hidden, ref point);
            foreach (KeyValuePair<uint, GroundMesh> entry in shown)
            {
                if (!entry.Value.Cast(origin, direction, null, ref point)) continue;
                point.Segment = entry.Key % segmentCount;
                isMet = true;
            }
            return isMet;
        }

        /// <summary>Ground on the vertical through a point: the highest not above it, else the lowest above it.</summary>
        public bool At(Vec3 position, out GroundPoint point)
        {
            return Cast(position, new Vec3(0, -1, 0), FarM, out point) || Cast(position, new Vec3(0, 1, 0), FarM, out point);
        }

        /// <summary>How often what is shown has changed.</summary>
        public int Changes { get; private set; }

        /// <summary>
        /// Faces of what is shown around a place, to be made solid: those whose box meets a cube. Where these are too many the cube is
        /// halved, four times at most.
        /// </summary>
        /// <param name="centre">Metres, scene frame.</param>
        /// <param name="halfM">Half the cube's side, metres.</param>
        /// <param name="mostFaces">Faces at most.</param>
        /// <param name="corners">What was there goes; then three corners a face, counter-clockwise from outside, scene frame.</param>
        /// <returns>Half the side of the cube of which all faces are there; 0 where that was none.</returns>
        public double Gather(Vec3 centre, double halfM, int mostFaces, List<float> corners)
        {
            for (int halving = 0; halving <= 4; halving++, halfM /= 2)
            {
                corners.Clear();
                bool isWhole = drawn == null || drawn.Gather(centre, halfM, hidden, mostFaces * 9, corners);
                foreach (KeyValuePair<uint, GroundMesh> entry in shown)
                {
                    isWhole = isWhole && entry.Value.Gather(centre, halfM, null, mostFaces * 9, corners);
                }
                if (isWhole) return halfM;
            }
            corners.Clear();
            return 0;
        }

        /// <inheritdoc/>
        public bool UploadBase(SceneFiles files)
        {
            if (comingFiles != files)
            {
                comingFiles = files;
                Prepared ahead = prepared;
                coming = ahead != null && ahead.Files == files ? ahead.Base : new GroundMesh(files.Base);
                prepared = null;
                // Ids mean other segments now; what is shown of the version before stays until its base goes.
                meshes.Clear();
            }
            return renderer.UploadBase(files);
        }

        /// <inheritdoc/>
        public void PrepareBase(FaceRange block, HiddenFaces next) { renderer.PrepareBase(block, next); }

        /// <inheritdoc/>
        public bool Upload(uint segment, SegmentMesh mesh)
        {
            if (!meshes.ContainsKey(segment)) meshes.Add(segment, new GroundMesh(mesh));
            return renderer.Upload(segment, mesh);
        }

        /// <inheritdoc/>
        public bool IsDrawable(uint segment) { return renderer.IsDrawable(segment); }

        /// <inheritdoc/>
        public void Free(uint segment)
        {
            meshes.Remove(segment);
            renderer.Free(segment);
        }

        /// <inheritdoc/>
        public void Swap(SceneSwap swap)
        {
            if (swap.IsNewBase)
            {
                shown.Clear();
                drawn = coming ?? drawn;
                if (comingFiles != null) segmentCount = (uint)comingFiles.Manifest.SegmentCount;
                coming = null;
            }
            else
            {
                foreach (uint segment in swap.Hidden) shown.Remove(segment);
            }
            foreach (uint segment in swap.Shown) shown[segment] = meshes[segment];
            // A copy: the mask is of the counters, which go ahead to the next landing.
            if (hidden.Length != swap.BaseHidden.Mask.Length) hidden = new byte[swap.BaseHidden.Mask.Length];
            Array.Copy(swap.BaseHidden.Mask, hidden, hidden.Length);
            Changes++;
            renderer.Swap(swap);
        }

        private sealed class Prepared
        {
            internal readonly SceneFiles Files;
            internal readonly GroundMesh Base;

            internal Prepared(SceneFiles files, GroundMesh mesh)
            {
                Files = files;
                Base = mesh;
            }
        }
    }
}
