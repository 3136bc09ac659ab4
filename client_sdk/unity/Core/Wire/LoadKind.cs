using System;

namespace Terraport.Wire
{
    /// <summary>Segments with what the scene's index says of them.</summary>
    internal sealed class LoadKind : PackedKind<SegmentFacts>
    {
        internal LoadKind(int maxRows) : base(maxRows, 48) {}

        protected override uint IdOf(SegmentFacts row) { return row.Segment; }

        protected override SegmentFacts RowAt(byte[] data, int at)
        {
            return new SegmentFacts(LittleEndian.ReadU32(data, at),
                // Beyond 2^31 it is negative, and refused with what is too long.
                unchecked((int)LittleEndian.ReadU32(data, at + 4)), LittleEndian.ReadU64(data, at + 8), LittleEndian.ReadU32(data, at + 16),
                LittleEndian.ReadU32(data, at + 20),
                new Box(LittleEndian.ReadF32(data, at + 24), LittleEndian.ReadF32(data, at + 28), LittleEndian.ReadF32(data, at + 32),
                    LittleEndian.ReadF32(data, at + 36), LittleEndian.ReadF32(data, at + 40), LittleEndian.ReadF32(data, at + 44)));
        }

        protected override void CheckRow(SegmentFacts row)
        {
            if (row.Length < 1 || row.Length > WireLimits.MaxSegmentBytes)
            {
                throw new RefusedException(
                    "got a length of " + unchecked((uint)row.Length) + ", expected 1 to " + WireLimits.MaxSegmentBytes, "length");
            }
            Box box = row.Bounds;
            if (!(IsCoordinate(box.MinX) && IsCoordinate(box.MinY) && IsCoordinate(box.MinZ) && IsCoordinate(box.MaxX)
                    && IsCoordinate(box.MaxY) && IsCoordinate(box.MaxZ)))
            {
                throw new RefusedException("got a coordinate that is no number of size at most " + WireLimits.MaxCoordinateM, "bounds");
            }
            if (box.MinX > box.MaxX || box.MinY > box.MaxY || box.MinZ > box.MaxZ)
            {
                throw new RefusedException("got a box whose min is above its max, expected min <= max", "bounds");
            }
        }

        protected override void WriteRow(byte[] data, int at, SegmentFacts row)
        {
            LittleEndian.WriteU32(data, at, row.Segment);
            LittleEndian.WriteU32(data, at + 4, (uint)row.Length);
            LittleEndian.WriteU64(data, at + 8, row.Xxh3);
            LittleEndian.WriteU32(data, at + 16, row.Faces);
            LittleEndian.WriteU32(data, at + 20, row.Vertices);
            LittleEndian.WriteF32(data, at + 24, row.Bounds.MinX);
            LittleEndian.WriteF32(data, at + 28, row.Bounds.MinY);
            LittleEndian.WriteF32(data, at + 32, row.Bounds.MinZ);
            LittleEndian.WriteF32(data, at + 36, row.Bounds.MaxX);
            LittleEndian.WriteF32(data, at + 40, row.Bounds.MaxY);
            LittleEndian.WriteF32(data, at + 44, row.Bounds.MaxZ);
        }

        // A NaN fails the comparison, an infinity too.
        private static bool IsCoordinate(float side) { return Math.Abs(side) <= WireLimits.MaxCoordinateM; }
    }
}
