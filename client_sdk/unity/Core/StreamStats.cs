namespace Terraport
{
    /// <summary>What a stream has counted since it was made, over all its connections; a snapshot.</summary>
    public sealed class StreamStats
    {
        /// <summary>Payload bytes received, whether they were used in the end or not.</summary>
        public long PayloadBytes { get; set; }

        /// <summary>Of them, bytes of segments that were held already: 0 unless something is wrong.</summary>
        public long RepeatedBytes { get; set; }

        /// <summary>Segments held now.</summary>
        public int HeldSegments { get; set; }

        /// <summary>Payload bytes of the segments held now.</summary>
        public long HeldBytes { get; set; }

        /// <summary>Landings that had an aim before them.</summary>
        public int AimedLandings { get; set; }

        /// <summary>Those of them that had nothing left to load.</summary>
        public int AimHits { get; set; }

        /// <summary>Payload bytes that aims brought.</summary>
        public long PrefetchedBytes { get; set; }

        /// <summary>Those of them that a landing then used.</summary>
        public long UsedPrefetchedBytes { get; set; }
    }
}
