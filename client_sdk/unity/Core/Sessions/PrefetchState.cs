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

        internal uint Generation { get; }

        internal long Bytes { get; }

        internal Dictionary<uint, SegmentFacts> Facts { get; } = new Dictionary<uint, SegmentFacts>();

        internal HashSet<uint> Waiting { get; } = new HashSet<uint>();
    }
}
