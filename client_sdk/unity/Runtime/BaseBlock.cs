using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>
    /// A block of the base: consecutive faces, in two pieces of ground of which one is drawn. The other takes the list of faces for
    /// the coming swap, which then only exchanges them.
    /// </summary>
    internal sealed class BaseBlock
    {
        private readonly PackedMesh packed;
        // front is the drawn one. They are exchanged at each swap that changes the block.
        private GroundNode front;
        private GroundNode back;

        /// <param name="faces">Which faces of the base.</param>
        /// <param name="packed">Their vertices, and the indices of all of them.</param>
        public BaseBlock(FaceRange faces, PackedMesh packed)
        {
            Faces = faces;
            this.packed = packed;
        }

        /// <summary>Faces of the base that the block holds.</summary>
        public FaceRange Faces { get; private set; }

        /// <summary>Whether both pieces are on the graphics card.</summary>
        public bool IsUploaded => back != null;

        /// <summary>Triangles that the front piece draws now.</summary>
        public int DrawnFaces => front != null && front.IsShown ? front.FaceCount : 0;

        /// <summary>One step of the upload: the first piece, then the second. The pack's vertices are not needed after that.</summary>
        public void Upload(GroundPool pool)
        {
            // Both copies hold all vertices: rewriting indices alone is cheap, and needs no vertex upload.
            GroundNode node = pool.Take();
            MeshFiller.Fill(node.Mesh, packed);
            node.FaceCount = Faces.Count;
            if (front == null)
            {
                front = node;
                return;
            }
            back = node;
            packed.DropVertices();
        }

        /// <summary>Set the material of both pieces; it stays the caller's.</summary>
        public void SetMaterial(Material material)
        {
            front.Material = material;
            back.Material = material;
        }

        /// <summary>Write the list of faces that will be drawn after <see cref="Flip"/>.</summary>
        /// <param name="hidden">One byte per face of the base, 1 where it is hidden.</param>
        /// <param name="scratch">At least as long as the block's indices.</param>
        public void Prepare(byte[] hidden, ushort[] scratch)
        {
            int indexCount = FaceList.Write(packed.ShortIndices, Faces, hidden, scratch);
            back.FaceCount = indexCount / 3;
            if (indexCount > 0)
            {
                MeshFiller.SetFaces(back.Mesh, packed, scratch, indexCount);
            }
        }

        /// <summary>Draw what was prepared, from the next frame on: flags only.</summary>
        public void Flip()
        {
            // A front without faces was hidden for that reason alone, and counts as shown.
            bool isShown = front.IsShown || front.FaceCount == 0;
            front.IsShown = false;
            GroundNode previous = front;
            front = back;
            back = previous;
            // A list without a face was not written: its piece stays hidden.
            front.IsShown = isShown && front.FaceCount > 0;
        }

        /// <summary>Draw the front piece, or not; one without faces stays hidden.</summary>
        public void Show(bool isShown) { front.IsShown = isShown && front.FaceCount > 0; }

        /// <summary>Return both pieces to the pool; the block is of no use afterwards.</summary>
        public void Release(GroundPool pool)
        {
            if (front != null)
            {
                pool.Return(front);
                front = null;
            }
            if (back != null)
            {
                pool.Return(back);
                back = null;
            }
        }
    }
}
