using System;

namespace Terraport.Unity
{
    /// <summary>
    /// Puts the base's faces into an order in which every block of consecutive faces is a compact piece of ground: few blocks then
    /// change in a swap, and blocks out of view are not drawn. The build's order serves the vertex cache; its blocks straggle.
    /// No engine; runs on a thread while the scene is loaded.
    /// </summary>
    public static class BaseOrder
    {
        /// <summary>
        /// The same files with base faces and cover rows in a new order: the same in both, so that face f is still row f. The
        /// indices of the base are changed in place.
        /// </summary>
        /// <param name="files">Of one version, used by nobody else yet.</param>
        /// <param name="blockFaces">Faces of a block, at least 1.</param>
        public static SceneFiles Sort(SceneFiles files, int blockFaces)
        {
            SegmentMesh mesh = files.Base;
            int faceCount = mesh.FaceCount;
            // 1. Centres, times three: only compared, so the division is saved.
            int[] order = new int[faceCount];
            float[] centres = new float[faceCount * 3];
            for (int face = 0; face < faceCount; face++)
            {
                order[face] = face;
                for (int corner = 0; corner < 3; corner++)
                {
                    float x, y, z;
                    mesh.PositionAt((int)mesh.Indices[face * 3 + corner], out x, out y, out z);
                    centres[face * 3] += x;
                    centres[face * 3 + 1] += y;
                    centres[face * 3 + 2] += z;
                }
            }
            // 2. A k-d split down to blocks; 3. faces and cover rows in that order.
            Split(order, centres, 0, faceCount, blockFaces);
            return new SceneFiles(files.Manifest, Reindexed(mesh, order), Reordered(files.Cover, order), files.Regions, files.Unions);
        }

        private static void Split(int[] order, float[] centres, int first, int end, int blockFaces)
        {
            int blocks = (end - first + blockFaces - 1) / blockFaces;
            if (blocks < 2)
            {
                Array.Sort(order, first, end - first); // Within a block the build's order, for the vertex cache.
                return;
            }
            // At a multiple of the block: every block but the last is full.
            int middle = first + blocks / 2 * blockFaces;
            int axis = LongestAxis(order, centres, first, end);
            Select(order, centres, axis, first, end - 1, middle);
            Split(order, centres, first, middle, blockFaces);
            Split(order, centres, middle, end, blockFaces);
        }

        private static int LongestAxis(int[] order, float[] centres, int first, int end)
        {
            int longestAxis = 0;
            float longestExtent = -1;
            for (int axis = 0; axis < 3; axis++)
            {
                float low = float.PositiveInfinity, high = float.NegativeInfinity;
                for (int at = first; at < end; at++)
                {
                    float centre = centres[order[at] * 3 + axis];
                    low = Math.Min(low, centre);
                    high = Math.Max(high, centre);
                }
                if (high - low > longestExtent)
                {
                    longestExtent = high - low;
                    longestAxis = axis;
                }
            }
            return longestAxis;
        }

        /// <summary>Quickselect (Hoare): afterwards no centre before the n-th is above it, and none after it below.</summary>
        private static void Select(int[] order, float[] centres, int axis, int low, int high, int nth)
        {
            while (low < high)
            {
                float pivot = centres[order[low + (high - low) / 2] * 3 + axis];
                int left = low, right = high;
                // Hoare's partition stops at equal keys on both sides, so equal centres do not make it quadratic.
                while (left <= right)
                {
                    while (centres[order[left] * 3 + axis] < pivot)
                    {
                        left++;
                    }
                    while (centres[order[right] * 3 + axis] > pivot)
                    {
                        right--;
                    }
                    if (left <= right)
                    {
                        int swapped = order[left];
                        order[left++] = order[right];
                        order[right--] = swapped;
                    }
                }
                if (nth <= right)
                {
                    high = right;
                }
                else if (nth >= left)
                {
                    low = left;
                }
                else
                {
                    return;
                }
            }
        }

        private static SegmentMesh Reindexed(SegmentMesh mesh, int[] order)
        {
            uint[] original = new uint[order.Length * 3];
            Array.Copy(mesh.Indices, original, original.Length);
            for (int face = 0; face < order.Length; face++)
            {
                Array.Copy(original, order[face] * 3, mesh.Indices, face * 3, 3);
            }
            return mesh;
        }

        private static Cover Reordered(Cover cover, int[] order)
        {
            uint[] offsets = new uint[cover.Offsets.Length];
            uint[] segments = new uint[cover.Segments.Length];
            uint at = 0;
            for (int face = 0; face < order.Length; face++)
            {
                uint begin = cover.Offsets[order[face]];
                uint count = cover.Offsets[order[face] + 1] - begin;
                // A row keeps its order: segments ascend within it.
                Array.Copy(cover.Segments, begin, segments, at, count);
                at += count;
                offsets[face + 1] = at;
            }
            return new Cover(offsets, segments);
        }
    }
}
