namespace Terraport
{
    /// <summary>What the manifest says of a file of its version.</summary>
    internal struct FileFacts
    {
        /// <summary>Bytes.</summary>
        internal int Length;

        /// <summary>XXH3-64.</summary>
        internal ulong Xxh3;
    }
}
