using System;
using System.Collections.Generic;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>
    /// Draws a scene for a <see cref="SceneStage"/>: base in blocks, one object per segment, everything hidden until a swap sets flags.
    /// Main thread.
    /// </summary>
    internal sealed class GroundRenderer : ISceneRenderer, IDisposable
    {
        private readonly GroundPool pool;
        private readonly PhotoLoader photos;
        private readonly GroundMaterials materials;
        private readonly int blockFaces;
        private readonly Dictionary<uint, GroundNode> nodes = new Dictionary<uint, GroundNode>();
        // Shown segments of the version before; ids mean other segments once a new base is on its way.
        private readonly Dictionary<uint, GroundNode> leaving = new Dictionary<uint, GroundNode>();
        // drawn is on the screen; coming is being uploaded, and takes its place in a swap. Each null where there is none.
        private BaseGround drawn;
        private BaseGround coming;

        public GroundRenderer(Transform parent, PhotoLoader photos, GroundMaterials materials, int blockFaces, bool isLit)
        {
            pool = new GroundPool(parent, isLit);
            this.photos = photos;
            this.materials = materials;
            this.blockFaces = blockFaces;
        }

        /// <summary>A base was drawn without its photograph; the argument says why.</summary>
        public event Action<TerraportException> BaseFault;

        /// <summary>Segments on the graphics card, or on their way.</summary>
        public int SegmentCount => nodes.Count;

        /// <summary>Objects that were made and not destroyed, spare ones too.</summary>
        public int ObjectCount => pool.Count;

        /// <summary>Triangles of shown segments and of the base that a camera that sees all of them draws.</summary>
        public long DrawnTriangles
        {
            get {
                long triangles = drawn == null ? 0 : drawn.DrawnFaces;
                foreach (KeyValuePair<uint, GroundNode> entry in nodes)
                {
                    triangles += entry.Value.IsShown ? entry.Value.FaceCount : 0;
                }
                return triangles;
            }
        }

        /// <inheritdoc/>
        public bool UploadBase(SceneFiles files)
        {
            if (coming == null || coming.Files != files)
            {
                // Files of a still newer version: what was uploaded of the one before was never drawn.
                if (coming != null)
                {
                    coming.Release();
                }
                LeaveVersion();
                coming = new BaseGround(files, blockFaces, pool, photos, materials);
            }
            return coming.Upload();
        }

        /// <inheritdoc/>
        public void PrepareBase(FaceRange block, HiddenFaces next) { (coming ?? drawn).Prepare(block, next); }

        /// <inheritdoc/>
        public bool Upload(uint segment, SegmentMesh mesh)
        {
            PackedMesh packed = mesh.EngineData as PackedMesh;
            if (packed == null || nodes.ContainsKey(segment))
            {
                throw new InvalidOperationException(
                    packed == null ? "segment " + segment + " was not packed" : "segment " + segment + " is there already");
            }
            // Before anything is reserved: Begin throws for a kind of image that nothing here reads.
            PhotoLoad photo = mesh.HasTexture ? photos.Begin(mesh.Image) : null;
            GroundNode node = pool.Take();
            nodes.Add(segment, node);
            MeshFiller.Fill(node.Mesh, packed);
            node.FaceCount = mesh.FaceCount;
            node.Photo = photo;
            if (photo == null)
            {
                node.Material = materials.Detail;
            }
            return true;
        }

        /// <inheritdoc/>
        public bool IsDrawable(uint segment)
        {
            GroundNode node = nodes[segment];
            if (node.Photo == null || node.PhotoMaterial != null)
            {
                return true;
            }
            if (node.Photo.Error != null)
            {
                throw node.Photo.Error;
            }
            if (!node.Photo.IsDone)
            {
                return false;
            }
            // First asked for after the photograph was read: from now on a swap only sets a flag.
            node.PhotoMaterial = materials.TakeDetail(node.Photo.Result);
            node.Material = node.PhotoMaterial;
            return true;
        }

        /// <inheritdoc/>
        public void Free(uint segment)
        {
            GroundNode node;
            if (nodes.TryGetValue(segment, out node))
            {
                nodes.Remove(segment);
                Release(node);
            }
        }

        /// <inheritdoc/>
        public void Swap(SceneSwap swap)
        {
            // 1. A new version: what is left of the old one goes, in the frame in which the new base is drawn.
            if (swap.IsNewBase && coming != null)
            {
                foreach (KeyValuePair<uint, GroundNode> entry in leaving)
                {
                    Release(entry.Value);
                }
                leaving.Clear();
                if (drawn != null)
                {
                    drawn.Release();
                }
                drawn = coming;
                coming = null;
                drawn.Show();
                if (drawn.Fault != null && BaseFault != null)
                {
                    BaseFault(drawn.Fault);
                }
            }
            // 2. Flags. Of a new base the hidden ids are the old version's, which have gone above.
            for (int at = 0; at < swap.Hidden.Count; at++)
            {
                GroundNode node;
                if (!swap.IsNewBase && nodes.TryGetValue(swap.Hidden[at], out node))
                {
                    node.IsShown = false;
                }
            }
            for (int at = 0; at < swap.Shown.Count; at++)
            {
                // Drawable, since the stage asked: only the flag is left to be set.
                nodes[swap.Shown[at]].IsShown = true;
            }
            // 3. The base's lists, in the same frame: no hole and no doubled ground in between.
            for (int at = 0; at < swap.ChangedBlocks.Count; at++)
            {
                drawn.Flip(swap.ChangedBlocks[at]);
            }
        }

        /// <summary>Give everything back that was made, at once.</summary>
        public void Dispose()
        {
            foreach (KeyValuePair<uint, GroundNode> entry in nodes)
            {
                Release(entry.Value);
            }
            nodes.Clear();
            foreach (KeyValuePair<uint, GroundNode> entry in leaving)
            {
                Release(entry.Value);
            }
            leaving.Clear();
            if (coming != null)
            {
                coming.Release();
                coming = null;
            }
            if (drawn != null)
            {
                drawn.Release();
                drawn = null;
            }
            pool.Dispose();
        }

        /// <summary>What is shown stays drawn, apart; everything else of the version before goes.</summary>
        private void LeaveVersion()
        {
            foreach (KeyValuePair<uint, GroundNode> entry in nodes)
            {
                // Out of `nodes`: a segment of the new version may have the same id.
                if (entry.Value.IsShown)
                {
                    leaving[entry.Key] = entry.Value;
                }
                else
                {
                    Release(entry.Value);
                }
            }
            nodes.Clear();
        }

        private void Release(GroundNode node)
        {
            if (node.PhotoMaterial != null)
            {
                materials.ReturnDetail(node.PhotoMaterial);
            }
            if (node.Photo != null)
            {
                photos.Abandon(node.Photo);
            }
            // Material and photograph first: the pool forgets them.
            pool.Return(node);
        }
    }
}
