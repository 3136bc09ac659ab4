using System;
using System.Linq;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>
    /// The base of one version, in blocks of two pieces each, of which one is drawn: the other takes the list of faces for the coming swap,
    /// which then only exchanges them. Main thread.
    /// </summary>
    internal sealed class BaseGround
    {
        private readonly GroundPool pool;
        private readonly PhotoLoader photos;
        private readonly GroundMaterials materials;
        private readonly PackedBase packed;
        private readonly double deviationM;
        private readonly GroundNode[] front, back;
        // Whether the back piece of a block has the coming list.
        private readonly bool[] isChanged;
        // One list of faces at a time is written; each is copied to the card before the next.
        private readonly ushort[] scratch = new ushort[3 * PackedBase.BlockFaces];
        private byte[] drawnHidden = Array.Empty<byte>(), comingHidden = Array.Empty<byte>();
        private int uploads, preparedBlocks;
        private PhotoLoad photo;
        private Material photoMaterial;
        private bool isReady;

        internal BaseGround(SceneFiles files, GroundPool pool, PhotoLoader photos, GroundMaterials materials)
        {
            Files = files;
            this.pool = pool;
            this.photos = photos;
            this.materials = materials;
            packed = (PackedBase)files.Prepared;
            deviationM = files.Manifest.DeviationM;
            materials.HasImagesOfPoints = files.Manifest.HasImagesOfPoints;
            front = new GroundNode[packed.Blocks.Count];
            back = new GroundNode[front.Length];
            isChanged = new bool[front.Length];
            if (packed.ImageFile != null) photo = photos.Begin(packed.ImageFile, packed.Image);
        }

        internal SceneFiles Files { get; }

        /// <summary>Why its image is missing; null where it is not. It is drawn plain then.</summary>
        internal TerraportException Fault => photo?.Error;

        internal int DrawnFaces => front.Sum(node => node.DrawnFaces);

        /// <summary>One slice of the upload; true once all of it can be drawn.</summary>
        internal bool Upload()
        {
            int block = uploads / 2;
            if (block < front.Length)
            {
                // Both pieces have all vertices: rewriting the indices alone is cheap.
                GroundNode node = pool.Take();
                MeshFiller.Fill(node.Mesh, packed.Blocks[block]);
                node.FaceCount = packed.FacesOf(block);
                (uploads % 2 == 0 ? front : back)[block] = node;
                if (uploads++ % 2 == 1) packed.Blocks[block].DropVertices();
                return false;
            }
            if (photo != null && !photo.IsDone) return false;
            if (isReady) return true;
            isReady = true;
            // Before the image's material is copied from the shared one.
            materials.SetPush(deviationM);
            if (photo != null && photo.Error == null) photoMaterial = materials.MakeBase(photo.Result);
            foreach (GroundNode node in front.Concat(back)) node.SetMaterial(photoMaterial != null ? photoMaterial : materials.Base);
            return true;
        }

        /// <summary>Draw all blocks: flags only.</summary>
        internal void Show()
        {
            // The material outlives this base: the version before may have pushed by another distance.
            materials.SetPush(deviationM);
            foreach (GroundNode node in front) node.IsShown = true;
        }

        /// <summary>Prepare one more block for a swap; true once all are.</summary>
        internal bool PrepareHidden(byte[] hidden)
        {
            if (hidden != comingHidden)
            {
                comingHidden = hidden;
                preparedBlocks = 0;
            }
            if (preparedBlocks == front.Length) return true;
            int block = preparedBlocks++;
            isChanged[block] = packed.Differs(block, drawnHidden, hidden);
            if (isChanged[block])
            {
                int count = packed.WriteVisible(block, hidden, scratch);
                back[block].FaceCount = count / 3;
                if (count > 0) MeshFiller.SetFaces(back[block].Mesh, packed.Blocks[block], scratch, count);
            }
            return preparedBlocks == front.Length;
        }

        /// <summary>Draw what was prepared: flags only.</summary>
        internal void Flip()
        {
            drawnHidden = comingHidden;
            for (int block = 0; block < front.Length; block++)
            {
                if (!isChanged[block]) continue;
                isChanged[block] = false;
                front[block].IsShown = false;
                GroundNode shown = back[block];
                back[block] = front[block];
                front[block] = shown;
                // A list without a face was not written.
                shown.IsShown = shown.FaceCount > 0;
            }
        }

        /// <summary>Give everything back.</summary>
        internal void Release()
        {
            foreach (GroundNode node in front.Concat(back).Where(node => node != null)) pool.Return(node);
            if (photo != null) photos.Abandon(photo);
            Engine.Destroy(photoMaterial);
        }
    }
}
