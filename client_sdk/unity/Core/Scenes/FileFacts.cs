namespace Terraport
{
    /// <summary>What the manifest says of a file of its version.</summary>
    internal struct FileFacts
    {
        /// <summary>Length of the file, bytes.</summary>
        internal int Length;

        /// <summary>XXH3-64 of the whole file, seed 0.</summary>
        internal ulong Xxh3;
    }
}
