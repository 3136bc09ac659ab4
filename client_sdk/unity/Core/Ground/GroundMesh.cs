using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// A mesh that rays are cast against. Boxes over 64 consecutive faces keep a ray to few of them: builds write faces in an order
    /// that is compact. A copy of its own: 12 bytes a vertex and 12 a face.
    /// </summary>
    internal sealed class GroundMesh
    {
        private const int BoxFaces = 64;

        private readonly float[] positions;
        private readonly int[] indices;
        // Six per box: lowest x y z, highest x y z. The last is around all.
        private readonly float[] boxes;
        private readonly int boxCount;

        /// <summary>Copy a mesh; O(faces).</summary>
        internal GroundMesh(SegmentMesh mesh)
        {
            FaceCount = mesh.FaceCount;
            positions = new float[mesh.VertexCount * 3];
            for (int vertex = 0; vertex < mesh.VertexCount; vertex++)
            {
                mesh.PositionAt(vertex, out positions[vertex * 3], out positions[vertex * 3 + 1], out positions[vertex * 3 + 2]);
            }
            indices = new int[FaceCount * 3];
            for (int at = 0; at < indices.Length; at++) indices[at] = (int)mesh.Indices[at] * 3;
            boxCount = (FaceCount + BoxFaces - 1) / BoxFaces;
            boxes = new float[6 * (boxCount + 1)];
            Empty(boxCount);
            for (int box = 0; box < boxCount; box++)
            {
                Empty(box);
                int end = Math.Min((box + 1) * BoxFaces, FaceCount) * 3;
                for (int at = box * BoxFaces * 3; at < end; at++)
                {
                    Grow(box, indices[at]);
                    Grow(boxCount, indices[at]);
                }
            }
        }

        internal int FaceCount { get; private set; }

        /// <summary>
        /// Take the nearest point of a ray at 0 &lt;= At &lt;= nearest.At into <paramref name="nearest"/>; whether there was one.
        /// Both sides of a face count. Faces of which the bit in <paramref name="hidden"/> is set are not there; an empty array hides none.
        /// </summary>
        internal bool Cast(Vec3 origin, Vec3 direction, byte[] hidden, ref GroundPoint nearest)
        {
            bool isMet = false;
            if (FaceCount == 0 || !Enters(boxCount, origin, direction, nearest.At)) return false;
            for (int box = 0; box < boxCount; box++)
            {
                if (!Enters(box, origin, direction, nearest.At)) continue;
                int end = Math.Min((box + 1) * BoxFaces, FaceCount);
                for (int face = box * BoxFaces; face < end; face++)
                {
                    if (!IsHidden(hidden, face) && Meets(face, origin, direction, ref nearest)) isMet = true;
                }
            }
            return isMet;
        }

        /// <summary>
        /// Add the corners of each face whose box meets a cube, nine numbers a face; false as soon as there would be more than so many
        /// numbers in all.
        /// </summary>
        internal bool Gather(Vec3 centre, double halfM, byte[] hidden, int mostNumbers, List<float> corners)
        {
            if (FaceCount == 0 || !IsNear(boxCount, centre, halfM)) return true;
            for (int box = 0; box < boxCount; box++)
            {
                if (!IsNear(box, centre, halfM)) continue;
                int end = Math.Min((box + 1) * BoxFaces, FaceCount);
                for (int face = box * BoxFaces; face < end; face++)
                {
                    if (IsHidden(hidden, face) || !IsFaceNear(face, centre, halfM)) continue;
                    if (corners.Count + 9 > mostNumbers) return false;
                    for (int corner = 0; corner < 3; corner++)
                    {
                        int first = indices[face * 3 + corner];
                        for (int axis = 0; axis < 3; axis++) corners.Add(positions[first + axis]);
                    }
                }
            }
            return true;
        }

        /// <summary>Whether a face is hidden, by one bit each; without bits none is.</summary>
        internal static bool IsHidden(byte[] hidden, int face) { return hidden.Length > 0 && (hidden[face >> 3] >> (face & 7) & 1) != 0; }

        private static bool Overlaps(double low, double high, double centre, double halfM)
        {
            return low <= centre + halfM && high >= centre - halfM;
        }

        private bool IsNear(int box, Vec3 centre, double halfM)
        {
            return Overlaps(boxes[box * 6], boxes[box * 6 + 3], centre.X, halfM)
                && Overlaps(boxes[box * 6 + 1], boxes[box * 6 + 4], centre.Y, halfM)
                && Overlaps(boxes[box * 6 + 2], boxes[box * 6 + 5], centre.Z, halfM);
        }

        private bool IsFaceNear(int face, Vec3 centre, double halfM)
        {
            Vec3 a = Corner(face * 3), b = Corner(face * 3 + 1), c = Corner(face * 3 + 2);
            return Overlaps(Math.Min(a.X, Math.Min(b.X, c.X)), Math.Max(a.X, Math.Max(b.X, c.X)), centre.X, halfM)
                && Overlaps(Math.Min(a.Y, Math.Min(b.Y, c.Y)), Math.Max(a.Y, Math.Max(b.Y, c.Y)), centre.Y, halfM)
                && Overlaps(Math.Min(a.Z, Math.Min(b.Z, c.Z)), Math.Max(a.Z, Math.Max(b.Z, c.Z)), centre.Z, halfM);
        }

        // Moeller and Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", 1997. In double: neighbours share their edge, and a
        // ray through it meets one of them at least.
        private bool Meets(int face, Vec3 origin, Vec3 direction, ref GroundPoint nearest)
        {
            Vec3 a = Corner(face * 3);
            Vec3 u = Corner(face * 3 + 1) - a, v = Corner(face * 3 + 2) - a;
            Vec3 p = Vec3.Cross(direction, v);
            double determinant = Vec3.Dot(u, p);
            if (determinant == 0) return false;
            Vec3 t = origin - a;
            double beta = Vec3.Dot(t, p) / determinant;
            Vec3 q = Vec3.Cross(t, u);
            double gamma = Vec3.Dot(direction, q) / determinant;
            double at = Vec3.Dot(v, q) / determinant;
            const double Slack = -1e-9;
            if (!(beta >= Slack && gamma >= Slack && beta + gamma <= 1 - Slack && at >= 0 && at <= nearest.At)) return false;
            Vec3 front = Vec3.Cross(u, v);
            double length = Math.Sqrt(Vec3.Dot(front, front));
            nearest.At = at;
            nearest.Position = origin + at * direction;
            nearest.Normal = 1 / length * front;
            return true;
        }

        // The slabs of the box's three axes (Kay and Kajiya, 1986).
        private bool Enters(int box, Vec3 origin, Vec3 direction, double most)
        {
            double enter = 0, leave = most;
            return Slab(box * 6, origin.X, direction.X, ref enter, ref leave)
                && Slab(box * 6 + 1, origin.Y, direction.Y, ref enter, ref leave)
                && Slab(box * 6 + 2, origin.Z, direction.Z, ref enter, ref leave);
        }

        private bool Slab(int at, double origin, double direction, ref double enter, ref double leave)
        {
            // A little wider than the box: the face's own test has a slack, too.
            double low = boxes[at] - 1e-6, high = boxes[at + 3] + 1e-6;
            if (direction == 0) return origin >= low && origin <= high;
            double first = (low - origin) / direction, second = (high - origin) / direction;
            enter = Math.Max(enter, Math.Min(first, second));
            leave = Math.Min(leave, Math.Max(first, second));
            return enter <= leave;
        }

        private void Empty(int box)
        {
            for (int axis = 0; axis < 3; axis++)
            {
                boxes[box * 6 + axis] = float.PositiveInfinity;
                boxes[box * 6 + 3 + axis] = float.NegativeInfinity;
            }
        }

        private void Grow(int box, int corner)
        {
            for (int axis = 0; axis < 3; axis++)
            {
                boxes[box * 6 + axis] = Math.Min(boxes[box * 6 + axis], positions[corner + axis]);
                boxes[box * 6 + 3 + axis] = Math.Max(boxes[box * 6 + 3 + axis], positions[corner + axis]);
            }
        }

        private Vec3 Corner(int at)
        {
            int first = indices[at];
            return new Vec3(positions[first], positions[first + 1], positions[first + 2]);
        }
    }
}
