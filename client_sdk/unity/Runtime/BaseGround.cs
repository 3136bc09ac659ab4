using System.Collections.Generic;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>The base of one version of a scene, in blocks. Uploaded in slices, shown in one frame. Main thread.</summary>
    internal sealed class BaseGround
    {
        private readonly GroundPool pool;
        private readonly PhotoLoader photos;
        private readonly GroundMaterials materials;
        // Vertices and indices by block; blocks are what of them is on the graphics card, in the same order.
        private readonly BaseBlocks source;
        private readonly List<BaseBlock> blocks = new List<BaseBlock>();
        private readonly double deviationM;
        private readonly int blockFaces;
        // One list of faces at a time is written; each is copied to the card before the next.
        private ushort[] scratch;
        // The base's photograph, while it is read and as long as the base lives; null without one.
        private PhotoLoad photo;
        private Material photoMaterial;
        private bool isReady;

        public BaseGround(SceneFiles files, int blockFaces, GroundPool pool, PhotoLoader photos, GroundMaterials materials)
        {
            Files = files;
            this.blockFaces = blockFaces;
            this.pool = pool;
            this.photos = photos;
            this.materials = materials;
            deviationM = files.Manifest.DeviationM;
            materials.SetPointImages(files.Manifest.TexturesOfPoints);
            source = files.Base.EngineData as BaseBlocks ?? new BaseBlocks(files.Base, blockFaces);
            files.Base.EngineData = null; // It is used up by the upload.
            scratch = new ushort[blockFaces * 3];
            if (files.Base.HasTexture)
            {
                BeginPhoto(files.Base.Image);
            }
        }

        /// <summary>Files of the version that it is the base of.</summary>
        public SceneFiles Files { get; private set; }

        /// <summary>Triangles that all blocks draw now.</summary>
        public int DrawnFaces
        {
            get {
                int faces = 0;
                for (int block = 0; block < blocks.Count; block++)
                {
                    faces += blocks[block].DrawnFaces;
                }
                return faces;
            }
        }

        /// <summary>One slice of the upload. True once all of it can be drawn.</summary>
        public bool Upload()
        {
            // The stage asks again until true; afterwards it need not, but may.
            if (isReady)
            {
                return true;
            }
            int last = blocks.Count - 1;
            // 1. A block takes two slices: its front and its back copy.
            if (last >= 0 && !blocks[last].IsUploaded)
            {
                blocks[last].Upload(pool);
                return false;
            }
            // 2. The next block; where no thread has packed it, packing is a slice of its own.
            if (blocks.Count < source.Count)
            {
                if (blocks.Count >= source.PackedCount)
                {
                    source.Step();
                    return false;
                }
                BaseBlock block = new BaseBlock(source.RangeOf(blocks.Count), source.PackedOf(blocks.Count));
                blocks.Add(block);
                block.Upload(pool);
                return false;
            }
            // 3. The photograph is read by PhotoLoader, once a frame.
            if (photo != null && !photo.IsDone)
            {
                return false;
            }
            // A base whose photograph cannot be read is still ground: it is drawn plain, and told of when it is shown.
            Finish();
            return true;
        }

        /// <summary>Why its photograph is missing; else null.</summary>
        public TerraportException Fault { get; private set; }

        /// <summary>Write the list of faces that one block has after its <see cref="Flip"/>.</summary>
        public void Prepare(FaceRange block, HiddenFaces next) { blocks[block.First / blockFaces].Prepare(next.Mask, scratch); }

        /// <summary>Draw the prepared list of one block from the next frame on: flags only.</summary>
        public void Flip(FaceRange block) { blocks[block.First / blockFaces].Flip(); }

        /// <summary>Draw all blocks, pushed back by this scene's deviation: flags only.</summary>
        public void Show()
        {
            // The material outlives this base: the version before may have pushed by another deviation.
            materials.SetPush(deviationM);
            for (int block = 0; block < blocks.Count; block++)
            {
                blocks[block].Show(true);
            }
        }

        /// <summary>Give everything back; nothing of it is drawn any more.</summary>
        public void Release()
        {
            for (int block = 0; block < blocks.Count; block++)
            {
                blocks[block].Release(pool);
            }
            blocks.Clear();
            if (photo != null)
            {
                photos.Abandon(photo);
                photo = null;
            }
            // Its own copy: the shared base material is the materials' to destroy.
            Engine.Destroy(photoMaterial);
        }

        private void BeginPhoto(MeshImage image)
        {
            try
            {
                photo = photos.Begin(image);
            }
            catch (TerraportException error)
            {
                Fault = error; // A kind of image that nothing here reads.
            }
        }

        private void Finish()
        {
            // Copied into the photograph's material below, so it must be right by then.
            materials.SetPush(deviationM);
            if (photo != null && photo.Error != null)
            {
                Fault = photo.Error;
            }
            else if (photo != null)
            {
                photoMaterial = materials.MakeBase(photo.Result);
            }
            for (int block = 0; block < blocks.Count; block++)
            {
                blocks[block].SetMaterial(photoMaterial != null ? photoMaterial : materials.Base);
            }
            isReady = true;
        }
    }
}
