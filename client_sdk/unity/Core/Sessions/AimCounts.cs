using System.Collections.Generic;

namespace Terraport.Sessions
{
    /// <summary>What aims have brought, and what of it landings have used, over all connections of a session.</summary>
    internal sealed class AimCounts
    {
        // Payload bytes of each segment that came for aims since the last plan, by id.
        private readonly Dictionary<uint, int> ahead = new Dictionary<uint, int>();
        private bool hasAimed;

        /// <summary>Landings that had an aim before them.</summary>
        internal int Landings { get; private set; }

        /// <summary>Those of them whose plan had nothing left to load.</summary>
        internal int Hits { get; private set; }

        /// <summary>Payload bytes of whole segments that came for aims.</summary>
        internal long PrefetchedBytes { get; private set; }

        /// <summary>Those of them that the next landing kept.</summary>
        internal long UsedBytes { get; private set; }

        /// <summary>Note that an aim is answered: the next landing is judged by it.</summary>
        internal void Prefetching() { hasAimed = true; }

        /// <summary>Note a whole segment that came for an aim.</summary>
        internal void Arrived(uint segment, int length)
        {
            PrefetchedBytes += length;
            ahead[segment] = length;
        }

        /// <summary>Judge what came ahead by the plan of the next landing.</summary>
        internal void Planned(uint[] keep, bool loads)
        {
            if (hasAimed)
            {
                hasAimed = false;
                Landings++;
                if (!loads) Hits++;
            }
            foreach (uint segment in keep)
            {
                int length;
                if (ahead.TryGetValue(segment, out length)) UsedBytes += length;
            }
            ahead.Clear();
        }
    }
}
