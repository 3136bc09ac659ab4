namespace Terraport
{
    /// <summary>Which faces of the base are not drawn. A live view of counters: read it within the call that gives it.</summary>
    public sealed class HiddenFaces
    {
        internal HiddenFaces(byte[] mask) { Mask = mask; }

        /// <summary>One byte per base face, 1 where it is hidden. Read only.</summary>
        public byte[] Mask { get; private set; }

        /// <summary>How many are hidden.</summary>
        public int Count { get; internal set; }

        /// <summary>Hash of the set of hidden faces, whatever the order in which they came to be hidden.</summary>
        public uint Hash { get; internal set; }
    }
}
