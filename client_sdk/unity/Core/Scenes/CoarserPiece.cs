using System.Collections.Generic;

namespace Terraport
{
    /// <summary>A coarser piece of ground: regions that are united at a cost, as a field's farm and a farm's valley.</summary>
    public sealed class CoarserPiece
    {
        internal CoarserPiece() {}

        /// <summary>What uniting them costs, from 1: more is coarser.</summary>
        public double Cost { get; internal set; }

        /// <summary>Its regions, ascending.</summary>
        public IReadOnlyList<int> Regions { get; internal set; }

        /// <summary>True area, square metres.</summary>
        public double AreaM2 { get; internal set; }

        /// <summary>What most of its named ground is called; null where none has a name.</summary>
        public string Label { get; internal set; }
    }
}
