namespace Terraport
{
    /// <summary>
    /// Rows of an accessor where they lie: in the payload, or decompressed. Valid until the next accessor is read.
    /// </summary>
    internal struct GlbRows
    {
        /// <summary>The array that the rows lie in: the payload's, or scratch memory.</summary>
        internal byte[] Bytes;

        /// <summary>Byte at which the first row starts.</summary>
        internal int Start;

        /// <summary>Number of rows.</summary>
        internal int Count;

        /// <summary>Bytes from one row to the next: 4, 8, 12 or 16.</summary>
        internal int Stride;

        /// <summary>glTF's component type, 5120 to 5126.</summary>
        internal int Component;

        /// <summary>The accessor states that its integers are fractions.</summary>
        internal bool IsNormalised;

        /// <summary>Rows are words of the filter EXPONENTIAL, not yet numbers.</summary>
        internal bool IsExponential;
    }
}
