namespace Terraport.Wire
{
    /// <summary>One held segment with its hash: a row of a held table.</summary>
    public readonly struct HeldRow
    {
        /// <summary>A segment and the hash of the payload that is held of it.</summary>
        public HeldRow(uint segment, ulong xxh3)
        {
            Segment = segment;
            Xxh3 = xxh3;
        }

        /// <summary>Segment id.</summary>
        public uint Segment { get; }

        /// <summary>XXH3-64 of the payload.</summary>
        public ulong Xxh3 { get; }
    }
}
