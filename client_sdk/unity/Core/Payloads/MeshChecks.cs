namespace Terraport
{
    /// <summary>
    /// What a GPU would not notice: numbers of vertices that are not there, normals without length, positions at
    /// infinity.
    /// </summary>
    internal static class MeshChecks
    {
        /// <summary>Every face uses vertices below <paramref name="vertices"/>.</summary>
        internal static void Indices(uint[] indices, int count, int vertices)
        {
            // One maximum instead of a comparison with an early exit: the loop has no branch to mispredict.
            uint highest = 0;
            for (int at = 0; at < count; at++)
            {
                uint index = indices[at];
                if (index > highest)
                {
                    highest = index;
                }
            }
            if (highest >= (uint)vertices)
            {
                throw new PayloadException("a face uses vertex " + highest + ", expected below " + vertices);
            }
        }

        /// <summary>No normal (four entries each, the fourth is padding) has length 0.</summary>
        internal static void NormalCodes(sbyte[] normals, int vertices)
        {
            for (int at = 0; at < vertices * 4; at += 4)
            {
                if (normals[at] == 0 && normals[at + 1] == 0 && normals[at + 2] == 0)
                {
                    throw new PayloadException("normal " + at / 4 + " has length 0, expected 1");
                }
            }
        }

        /// <summary>Every one of the first <paramref name="count"/> numbers is finite.</summary>
        internal static void Finite(float[] values, int count, string label)
        {
            // One sum instead of a test a number: the loop stays free of branches.
            float sum = 0;
            for (int at = 0; at < count; at++)
            {
                // Zero for finite numbers; a NaN or an infinity makes NaN, and stays.
                sum += 0 * values[at];
            }
            if (sum != 0)
            {
                throw new PayloadException("a number of " + label + " is not finite, expected finite numbers");
            }
        }

        /// <summary>Bounds of positions that are codes: the codes' own, and the box in metres, placed as a GPU places them.</summary>
        internal static void Place(SegmentMesh mesh)
        {
            ushort[] codes = mesh.CodeBounds;
            CodeBounds(mesh.PositionCodes, mesh.VertexCount, codes);
            Vec3 translation = mesh.Translation;
            double step = mesh.StepM;
            mesh.Bounds = new Box(ToFloat32(translation.X + step * codes[0]), ToFloat32(translation.Y + step * codes[1]),
                ToFloat32(translation.Z + step * codes[2]), ToFloat32(translation.X + step * codes[3]),
                ToFloat32(translation.Y + step * codes[4]), ToFloat32(translation.Z + step * codes[5]));
        }

        /// <summary>A coordinate in float32, metres.</summary>
        private static float ToFloat32(double metres)
        {
            // In double until here: one rounding to float32, as a GPU would place it.
            float value = (float)metres;
            if (value - value != 0)
            {
                throw new PayloadException("a position beyond float32, expected finite numbers");
            }
            return value;
        }

        /// <summary>Lowest and highest code along each axis of four entries a vertex, into x y z x y z.</summary>
        private static void CodeBounds(ushort[] codes, int vertices, ushort[] bounds)
        {
            // Locals, not the array: it could be the codes themselves to the compiler.
            int minX = 65535, minY = 65535, minZ = 65535, maxX = 0, maxY = 0, maxZ = 0;
            for (int at = 0; at < vertices * 4; at += 4)
            {
                int x = codes[at];
                int y = codes[at + 1];
                int z = codes[at + 2];
                minX = x < minX ? x : minX;
                maxX = x > maxX ? x : maxX;
                minY = y < minY ? y : minY;
                maxY = y > maxY ? y : maxY;
                minZ = z < minZ ? z : minZ;
                maxZ = z > maxZ ? z : maxZ;
            }
            bounds[0] = (ushort)minX;
            bounds[1] = (ushort)minY;
            bounds[2] = (ushort)minZ;
            bounds[3] = (ushort)maxX;
            bounds[4] = (ushort)maxY;
            bounds[5] = (ushort)maxZ;
        }

        /// <summary>Box of finite positions, three entries a vertex.</summary>
        internal static Box BoundsOf(float[] positions, int vertices)
        {
            float minX = float.PositiveInfinity, minY = minX, minZ = minX;
            float maxX = float.NegativeInfinity, maxY = maxX, maxZ = maxX;
            for (int at = 0; at < vertices * 3; at += 3)
            {
                float x = positions[at];
                float y = positions[at + 1];
                float z = positions[at + 2];
                minX = x < minX ? x : minX;
                maxX = x > maxX ? x : maxX;
                minY = y < minY ? y : minY;
                maxY = y > maxY ? y : maxY;
                minZ = z < minZ ? z : minZ;
                maxZ = z > maxZ ? z : maxZ;
            }
            return new Box(minX, minY, minZ, maxX, maxY, maxZ);
        }

        /// <summary>No code of a pair (two entries each) leaves the image.</summary>
        internal static void UvCodes(ushort[] codes, int vertices, double scaleU, double scaleV)
        {
            int maxU = 0;
            int maxV = 0;
            for (int at = 0; at < vertices * 2; at += 2)
            {
                maxU = codes[at] > maxU ? codes[at] : maxU;
                maxV = codes[at + 1] > maxV ? codes[at + 1] : maxV;
            }
            if (maxU * scaleU > 1 || maxV * scaleV > 1)
            {
                throw new PayloadException("texture coordinates beyond the image, expected 0 to 1");
            }
        }
    }
}
