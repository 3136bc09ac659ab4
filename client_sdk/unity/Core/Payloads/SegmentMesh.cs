using System;
using System.Collections.Generic;

namespace Terraport
{
    /// <summary>
    /// A decoded payload, or the base mesh. Its buffers grow and are reused, so that decoding allocates nothing once they are
    /// large enough: arrays may be longer than the counts say, and an array counts only where its flag is true.
    /// </summary>
    public sealed class SegmentMesh
    {
        private readonly List<MeshAttribute> attributes = new List<MeshAttribute>();
        private readonly List<MeshAttribute> spareAttributes = new List<MeshAttribute>();

        /// <summary>An empty mesh.</summary>
        public SegmentMesh() { Image = new MeshImage(); }

        /// <summary>Vertices; 0 in a mesh that holds nothing.</summary>
        public int VertexCount { get; internal set; }

        /// <summary>Triangles.</summary>
        public int FaceCount { get; internal set; }

        /// <summary>
        /// Metres, scene frame: a vertex lies at Translation + StepM * code, exact in float32. 0 for float positions.
        /// </summary>
        public Vec3 Translation { get; internal set; }

        /// <summary>Metres of one step of a code; 1 for float positions.</summary>
        public double StepM { get; internal set; }

        /// <summary>Whether positions are <see cref="Positions"/>; else <see cref="PositionCodes"/>.</summary>
        public bool HasFloatPositions { get; internal set; }

        /// <summary>Four per vertex, the fourth is padding.</summary>
        public ushort[] PositionCodes { get; internal set; } = Array.Empty<ushort>();

        /// <summary>Three per vertex, metres, scene frame.</summary>
        public float[] Positions { get; internal set; } = Array.Empty<float>();

        /// <summary>Four per vertex, 127 is 1, the fourth is padding.</summary>
        public sbyte[] NormalCodes { get; internal set; } = Array.Empty<sbyte>();

        /// <summary>Whether the vertices have colours.</summary>
        public bool HasColours { get; internal set; }

        /// <summary>Four per vertex, linear light, 65535 is 1.</summary>
        public ushort[] LinearColours { get; internal set; } = Array.Empty<ushort>();

        /// <summary>
        /// Whether there is an image, and texture coordinates; (0, 0) is its upper left corner.
        /// </summary>
        public bool HasTexture => Image.Length > 0;

        /// <summary>Two per vertex; a coordinate is code * <see cref="UvScaleU"/> or <see cref="UvScaleV"/>.</summary>
        public ushort[] UvCodes { get; internal set; } = Array.Empty<ushort>();

        /// <summary>Texture coordinate of one step of the first code.</summary>
        public double UvScaleU { get; internal set; }

        /// <summary>Texture coordinate of one step of the second code.</summary>
        public double UvScaleV { get; internal set; }

        /// <summary>The image's file; its Length is 0 without a texture.</summary>
        public MeshImage Image { get; private set; }

        /// <summary>Whether every vertex has a region id.</summary>
        public bool HasRegionIds { get; internal set; }

        /// <summary>Region id of each vertex, in this scene version.</summary>
        public ushort[] RegionIds { get; internal set; } = Array.Empty<ushort>();

        /// <summary>The survey's attributes, in the payload's order.</summary>
        public IReadOnlyList<MeshAttribute> Attributes => attributes;

        /// <summary>Three per face, counter-clockwise seen from outside, each below <see cref="VertexCount"/>.</summary>
        public uint[] Indices { get; internal set; } = Array.Empty<uint>();

        /// <summary>Whether every index fits into 16 bits, 65535 (primitive restart) left out.</summary>
        public bool HasShortIndices => VertexCount <= 65535;

        /// <summary>Lowest and highest position code along each axis, x y z x y z; zeros for float positions.</summary>
        public ushort[] CodeBounds { get; private set; } = new ushort[6];

        /// <summary>Box of the decoded positions, metres, scene frame.</summary>
        public Box Bounds { get; internal set; }

        /// <summary>Whatever an engine keeps with the mesh; survives Clear, so that its buffers are used again.</summary>
        public object EngineData { get; set; }

        /// <summary>
        /// Bytes that it takes on a GPU: vertices and indices as they are here, and the image with its mips in the form that GPUs keep.
        /// </summary>
        public long GpuBytes
        {
            get {
                // An estimate for budgets, by the payload alone: engines pack vertices in forms of their own.
                long vertex = (HasFloatPositions ? 12 : 8) + 4;
                vertex += HasColours ? 8 : 0;
                vertex += HasTexture ? 4 : 0;
                vertex += HasRegionIds ? 4 : 0;
                vertex += 4L * attributes.Count;
                long image = HasTexture ? Image.GpuBytes : 0;
                return vertex * VertexCount + (HasShortIndices ? 6L : 12L) * FaceCount + image;
            }
        }

        /// <summary>The position of a vertex in float32 metres, as every terraport client rounds it.</summary>
        public void PositionAt(int vertex, out float x, out float y, out float z)
        {
            if (HasFloatPositions)
            {
                x = Positions[vertex * 3];
                y = Positions[vertex * 3 + 1];
                z = Positions[vertex * 3 + 2];
                return;
            }
            // In double, then one rounding: the sum is exact in float32 for scenes that the build writes.
            x = (float)(Translation.X + StepM * PositionCodes[vertex * 4]);
            y = (float)(Translation.Y + StepM * PositionCodes[vertex * 4 + 1]);
            z = (float)(Translation.Z + StepM * PositionCodes[vertex * 4 + 2]);
        }

        /// <summary>The normal of a vertex, unit in float32, as every terraport client rounds it.</summary>
        public void NormalAt(int vertex, out float x, out float y, out float z)
        {
            // -128 and -127 both mean -1 (glTF 2.0).
            float a = Math.Max((float)(NormalCodes[vertex * 4] / 127f), -1f);
            float b = Math.Max((float)(NormalCodes[vertex * 4 + 1] / 127f), -1f);
            float c = Math.Max((float)(NormalCodes[vertex * 4 + 2] / 127f), -1f);
            // Every step rounded to float32, as NumPy does it.
            float length = (float)Math.Sqrt((float)((float)((float)(a * a) + (float)(b * b)) + (float)(c * c)));
            x = (float)(a / length);
            y = (float)(b / length);
            z = (float)(c / length);
        }

        /// <summary>The colour of a vertex, sRGB, 0 to 255: the survey's own. Only where <see cref="HasColours"/>.</summary>
        public void ColourAt(int vertex, out byte red, out byte green, out byte blue)
        {
            int at = vertex * 4;
            red = LinearColour.ToSrgb(LinearColours[at]);
            green = LinearColour.ToSrgb(LinearColours[at + 1]);
            blue = LinearColour.ToSrgb(LinearColours[at + 2]);
        }

        /// <summary>
        /// The texture coordinates of a vertex, 0 to 1, (0, 0) the image's upper left. Only where
        /// <see cref="HasTexture"/>.
        /// </summary>
        public void UvAt(int vertex, out float u, out float v)
        {
            // Codes without a transform are divided, so that 65535 is 1.
            bool isFraction = UvScaleU == 1.0 / 65535;
            u = isFraction ? UvCodes[vertex * 2] / 65535f : (float)(UvCodes[vertex * 2] * UvScaleU);
            v = isFraction ? UvCodes[vertex * 2 + 1] / 65535f : (float)(UvCodes[vertex * 2 + 1] * UvScaleV);
        }

        /// <summary>Hold nothing; buffers and <see cref="EngineData"/> stay.</summary>
        internal void Clear()
        {
            VertexCount = 0;
            FaceCount = 0;
            HasColours = false;
            HasRegionIds = false;
            HasFloatPositions = false;
            Translation = default(Vec3);
            StepM = 1;
            UvScaleU = 0;
            UvScaleV = 0;
            Bounds = default(Box);
            Array.Clear(CodeBounds, 0, CodeBounds.Length);
            Image.Clear();
            for (int at = attributes.Count - 1; at >= 0; at--)
            {
                spareAttributes.Add(attributes[at]);
            }
            attributes.Clear();
        }

        /// <summary>One more attribute, its arrays of an earlier use.</summary>
        internal MeshAttribute AddAttribute()
        {
            MeshAttribute attribute;
            // From the end of a list: taking there moves nothing.
            int last = spareAttributes.Count - 1;
            if (last >= 0)
            {
                attribute = spareAttributes[last];
                spareAttributes.RemoveAt(last);
            }
            else
            {
                attribute = new MeshAttribute();
            }
            attributes.Add(attribute);
            return attribute;
        }
    }
}
