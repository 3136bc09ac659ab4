namespace Terraport
{
    /// <summary>One survey attribute of a mesh. Buffers are reused: only the first VertexCount entries count.</summary>
    public sealed class MeshAttribute
    {
        /// <summary>The survey's own name.</summary>
        public string Name { get; internal set; }

        /// <summary>From GLB: value = Offset + Step * code; 0 from arrays.</summary>
        public double Offset { get; internal set; }

        /// <summary>Value of one code's step; 0 from arrays.</summary>
        public double Step { get; internal set; }

        /// <summary>From GLB: one code per vertex, 65535 for "no value". Null from arrays.</summary>
        public ushort[] Codes { get; internal set; }

        /// <summary>From arrays: one value per vertex, NaN for "no value". Null from GLB.</summary>
        public float[] Values { get; internal set; }

        /// <summary>The value at a vertex in float32, as every terraport client rounds it; NaN for none.</summary>
        public float ValueAt(int vertex)
        {
            if (Codes == null)
            {
                return Values[vertex];
            }
            ushort code = Codes[vertex];
            return code == 65535 ? float.NaN : (float)(Offset + Step * code);
        }
    }
}
