using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>What an aim brings.</summary>
    internal sealed class PrefetchState
    {
        internal PrefetchState(PrefetchMessage message)
        {
            Generation = message.Generation;
            Bytes = message.Bytes;
            foreach (SegmentFacts facts in message.Segments)
            {
                Facts.Add(facts.Segment, facts);
                Waiting.Add(facts.Segment);
            }
        }

        /// <summary>Generation of the aim, in which its frames come.</summary>
        internal uint Generation { get; }

        /// <summary>Payload bytes of all its segments.</summary>
        internal long Bytes { get; }

        /// <summary>Its load table, by id.</summary>
        internal Dictionary<uint, SegmentFacts> Facts { get; } = new Dictionary<uint, SegmentFacts>();

        /// <summary>Ids whose payload is not here yet.</summary>
        internal HashSet<uint> Waiting { get; } = new HashSet<uint>();
    }
}
