namespace Terraport.Unity
{
    /// <summary>
    /// The one place where the scene's frame becomes Unity's, and back.
    ///
    /// Scene: metres, right-handed, x east, y up, z south. Unity: metres, left-handed, Y up; here X east, Y up, Z north. So
    /// (X, Y, Z) = (x, y, -z): a reflection, which turns each triangle's winding round; two of its corners are exchanged.
    /// Texture coordinates of a payload count from the image's upper left corner, Unity's from the lower left.
    ///
    /// Negating is exact in float32: positions that were equal stay equal. Plain arithmetic, no engine: this file is compiled
    /// and run without Unity by the tests.
    /// </summary>
    public static class Axes
    {
        /// <summary>A position or direction of the scene, in Unity's axes. Its own inverse.</summary>
        public static Vec3 Turn(Vec3 vector) { return new Vec3(vector.X, vector.Y, -vector.Z); }

        /// <summary>The Z of Unity for a z of the scene, and the other way round.</summary>
        public static float TurnZ(float z) { return -z; }

        /// <summary>The normal's third component, a signed byte of which 127 is 1. -128, which is -1 as well, stays in range.</summary>
        public static sbyte TurnNormalZ(sbyte z) { return z == sbyte.MinValue ? sbyte.MaxValue : (sbyte)-z; }

        /// <summary>Unity's V of a payload's V, which counts downwards.</summary>
        public static float TurnV(float v) { return 1f - v; }

        /// <summary>A box of the scene in Unity's axes: its least and greatest Z change places.</summary>
        public static Box Turn(Box box) { return new Box(box.MinX, box.MinY, -box.MaxZ, box.MaxX, box.MaxY, -box.MinZ); }

        /// <summary>
        /// Positions in Unity's axes, three floats per vertex, from codes of the grid, four per vertex (the fourth is padding):
        /// translation + step * code, exact in float32.
        /// </summary>
        /// <remarks><c>into</c>: at least 3 * vertexCount long.</remarks>
        public static void Positions(
            ushort[] codes, int vertexCount, float translationX, float translationY, float translationZ, float stepM, float[] into)
        {
            for (int vertex = 0, from = 0, to = 0; vertex < vertexCount; vertex++, from += 4, to += 3)
            {
                into[to] = translationX + stepM * codes[from];
                into[to + 1] = translationY + stepM * codes[from + 1];
                // Translated before it is turned: the sum is exact, as the scene format promises, and so is its negation.
                into[to + 2] = TurnZ(translationZ + stepM * codes[from + 2]);
            }
        }

        /// <summary>Positions in Unity's axes from positions in metres, three floats per vertex both.</summary>
        /// <remarks><c>into</c>: at least 3 * vertexCount long; may be the same array.</remarks>
        public static void Positions(float[] metres, int vertexCount, float[] into)
        {
            for (int at = 0; at < vertexCount * 3; at += 3)
            {
                into[at] = metres[at];
                into[at + 1] = metres[at + 1];
                into[at + 2] = TurnZ(metres[at + 2]);
            }
        }

        /// <summary>Normals, four signed bytes per vertex (the fourth is padding, written as 0).</summary>
        /// <remarks><c>into</c>: at least 4 * vertexCount long; may be the same array.</remarks>
        public static void Normals(sbyte[] normals, int vertexCount, sbyte[] into)
        {
            for (int at = 0; at < vertexCount * 4; at += 4)
            {
                into[at] = normals[at];
                into[at + 1] = normals[at + 1];
                into[at + 2] = TurnNormalZ(normals[at + 2]);
                into[at + 3] = 0;
            }
        }

        /// <summary>Corners of faces, clockwise seen from outside as Unity wants them: the second and third change places.</summary>
        /// <remarks><c>into</c>: at least 3 * faceCount long; may be the same array.</remarks>
        public static void Indices(uint[] indices, int faceCount, uint[] into)
        {
            for (int at = 0; at < faceCount * 3; at += 3)
            {
                // Read first: the arrays may be one and the same.
                uint second = indices[at + 1];
                into[at] = indices[at];
                into[at + 1] = indices[at + 2];
                into[at + 2] = second;
            }
        }

        /// <summary>Texture coordinates, two floats per vertex, from codes: (u, 1 - v) of scale * code.</summary>
        /// <remarks><c>into</c>: at least 2 * vertexCount long.</remarks>
        public static void Uvs(ushort[] codes, int vertexCount, float scaleU, float scaleV, float[] into)
        {
            for (int at = 0; at < vertexCount * 2; at += 2)
            {
                into[at] = scaleU * codes[at];
                into[at + 1] = TurnV(scaleV * codes[at + 1]);
            }
        }

        /// <summary>Texture coordinates, two floats per vertex, from floats.</summary>
        /// <remarks><c>into</c>: at least 2 * vertexCount long; may be the same array.</remarks>
        public static void Uvs(float[] uvs, int vertexCount, float[] into)
        {
            for (int at = 0; at < vertexCount * 2; at += 2)
            {
                into[at] = uvs[at];
                into[at + 1] = TurnV(uvs[at + 1]);
            }
        }
    }
}
