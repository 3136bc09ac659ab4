namespace Terraport
{
    /// <summary>
    /// Which segments lie over each base face: over face f those of <c>Segments[Offsets[f]]</c> to
    /// <c>Segments[Offsets[f + 1] - 1]</c>, ascending.
    /// </summary>
    public sealed class Cover
    {
        /// <summary>Rows that were checked: see <see cref="CoverReader"/>.</summary>
        public Cover(uint[] offsets, uint[] segments)
        {
            Offsets = offsets;
            Segments = segments;
        }

        /// <summary>One more than there are base faces; from 0 to the length of <see cref="Segments"/>, never falling.</summary>
        public uint[] Offsets { get; private set; }

        /// <summary>Segment ids, row after row; below the manifest's SegmentCount.</summary>
        public uint[] Segments { get; private set; }
    }
}
