namespace Terraport
{
    /// <summary>One survey attribute of a mesh. Buffers are reused: only the first VertexCount entries count.</summary>
    public sealed class MeshAttribute
    {
        /// <summary>The survey's own name.</summary>
        public string Name { get; internal set; }

        /// <summary>Value of code 0: value = Offset + Step * code.</summary>
        public double Offset { get; internal set; }

        /// <summary>Value of one code's step.</summary>
        public double Step { get; internal set; }

        /// <summary>One code per vertex, 65535 for "no value".</summary>
        public ushort[] Codes { get; internal set; }

        /// <summary>The value at a vertex in float32, as every terraport client rounds it; NaN for none.</summary>
        public float ValueAt(int vertex)
        {
            ushort code = Codes[vertex];
            return code == 65535 ? float.NaN : (float)(Offset + Step * code);
        }
    }
}
