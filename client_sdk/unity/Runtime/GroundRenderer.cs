using System;
using System.Collections.Generic;
using System.Linq;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>Draws a scene: the base in blocks, one object for each segment, everything hidden until a swap sets flags.</summary>
    internal sealed class GroundRenderer : IGroundRenderer, IDisposable
    {
        private const int MaxSparePacks = 32;

        private readonly GroundPool pool;
        private readonly PhotoLoader photos;
        private readonly GroundMaterials materials;
        private readonly Dictionary<ulong, GroundNode> nodes = new Dictionary<ulong, GroundNode>();
        // Also the lock: meshes are packed on the decoding threads.
        private readonly Stack<PackedMesh> sparePacks = new Stack<PackedMesh>();
        // The base on the screen, and the one that is being uploaded to take its place; each null where there is none.
        private BaseGround drawn, coming;

        internal GroundRenderer(Transform parent, PhotoLoader photos, GroundMaterials materials, bool isLit)
        {
            pool = new GroundPool(parent, isLit);
            this.photos = photos;
            this.materials = materials;
        }

        /// <summary>A base was drawn without its image.</summary>
        internal event Action<TerraportException> BaseFault;

        /// <summary>Objects that were made and not destroyed.</summary>
        internal int ObjectCount => pool.Count;

        /// <summary>Triangles that a camera that sees everything draws.</summary>
        internal long DrawnTriangles => (drawn?.DrawnFaces ?? 0) + nodes.Values.Sum(node => (long)node.DrawnFaces);

        public object Prepare(SegmentMesh mesh)
        {
            PackedMesh packed;
            lock (sparePacks) packed = sparePacks.Count > 0 ? sparePacks.Pop() : new PackedMesh();
            packed.Pack(mesh);
            return packed;
        }

        public object PrepareBase(SceneFiles files) { return new PackedBase(files.Base); }

        public void Discard(object prepared)
        {
            lock (sparePacks)
            {
                if (sparePacks.Count < MaxSparePacks) sparePacks.Push((PackedMesh)prepared);
            }
        }

        public bool UploadBase(SceneFiles files)
        {
            if (coming?.Files != files)
            {
                // Files of a still newer version: what was uploaded of the one before was never drawn.
                coming?.Release();
                coming = new BaseGround(files, pool, photos, materials);
            }
            return coming.Upload();
        }

        public void Upload(ulong key, object prepared)
        {
            var packed = (PackedMesh)prepared;
            // First, since it throws for a kind of image that cannot be read here.
            PhotoLoad photo = packed.ImageFile == null ? null : photos.Begin(packed.ImageFile, packed.Image);
            GroundNode node = pool.Take();
            nodes.Add(key, node);
            MeshFiller.Fill(node.Mesh, packed);
            node.FaceCount = packed.IndexCount / 3;
            node.Photo = photo;
            if (photo == null) node.SetMaterial(materials.Detail);
        }

        public bool IsDrawable(ulong key)
        {
            GroundNode node = nodes[key];
            if (node.Photo == null || node.PhotoMaterial != null) return true;
            if (node.Photo.Error != null) throw node.Photo.Error;
            if (!node.Photo.IsDone) return false;
            node.PhotoMaterial = materials.TakeDetail(node.Photo.Result);
            node.SetMaterial(node.PhotoMaterial);
            return true;
        }

        public void Free(ulong key)
        {
            Release(nodes[key]);
            nodes.Remove(key);
        }

        public bool PrepareHidden(byte[] hidden) { return drawn.PrepareHidden(hidden); }

        public void Swap(bool isNewBase, HashSet<ulong> shown)
        {
            if (isNewBase)
            {
                drawn?.Release();
                drawn = coming;
                coming = null;
                drawn.Show();
                if (drawn.Fault != null) BaseFault?.Invoke(drawn.Fault);
            }
            foreach (KeyValuePair<ulong, GroundNode> node in nodes) node.Value.IsShown = shown.Contains(node.Key);
            // In the same frame: no hole and no doubled ground in between.
            if (!isNewBase) drawn.Flip();
        }

        public void Dispose()
        {
            foreach (GroundNode node in nodes.Values) Release(node);
            nodes.Clear();
            coming?.Release();
            drawn?.Release();
            pool.Dispose();
        }

        private void Release(GroundNode node)
        {
            if (node.PhotoMaterial != null) materials.ReturnDetail(node.PhotoMaterial);
            if (node.Photo != null) photos.Abandon(node.Photo);
            pool.Return(node);
        }
    }
}
