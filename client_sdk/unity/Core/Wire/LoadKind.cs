using System;
using Terraport.Json;

namespace Terraport.Wire
{
    /// <summary>Segments with what the scene's index says of them.</summary>
    internal sealed class LoadKind : PackedKind<SegmentFacts>
    {
        internal LoadKind(int most)
            : base(most, 48)
        {
        }

        protected override uint IdOf(SegmentFacts row)
        {
            return row.Segment;
        }

        protected override SegmentFacts RowAt(byte[] data, int at)
        {
            return new SegmentFacts(
                LittleEndian.ReadU32(data, at),
                // Beyond 2^31 it is negative, and refused with what is too long.
                unchecked((int)LittleEndian.ReadU32(data, at + 4)),
                LittleEndian.ReadU64(data, at + 8),
                LittleEndian.ReadU32(data, at + 16),
                LittleEndian.ReadU32(data, at + 20),
                new Box(
                    LittleEndian.ReadF32(data, at + 24),
                    LittleEndian.ReadF32(data, at + 28),
                    LittleEndian.ReadF32(data, at + 32),
                    LittleEndian.ReadF32(data, at + 36),
                    LittleEndian.ReadF32(data, at + 40),
                    LittleEndian.ReadF32(data, at + 44)));
        }

        protected override SegmentFacts RowOf(JsonValue raw)
        {
            if (raw.Kind != JsonKind.Object) throw new RefusedException("got " + raw.Show() + ", expected a segment object");
            Box bounds = BoundsOf(raw["bounds"]);
            return new SegmentFacts(
                Whole(raw, "id"),
                unchecked((int)Whole(raw, "length")),
                HashOf(raw),
                Whole(raw, "faces"),
                Whole(raw, "vertices"),
                bounds);
        }

        protected override void CheckRow(SegmentFacts row)
        {
            if (row.Length < 1 || row.Length > WireLimits.MaxSegmentBytes)
            {
                throw new RefusedException(
                    "got a length of " + unchecked((uint)row.Length) + ", expected 1 to " + WireLimits.MaxSegmentBytes, "length");
            }
            Box box = row.Bounds;
            if (!(IsCoordinate(box.MinX) && IsCoordinate(box.MinY) && IsCoordinate(box.MinZ)
                && IsCoordinate(box.MaxX) && IsCoordinate(box.MaxY) && IsCoordinate(box.MaxZ)))
            {
                throw new RefusedException(
                    "got a coordinate that is no number of size at most " + WireLimits.MaxCoordinateM, "bounds");
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

        protected override JsonValue ListRow(SegmentFacts row)
        {
            Box box = row.Bounds;
            JsonValue bounds = JsonValue.OfList(new[]
            {
                JsonValue.OfFloat(box.MinX), JsonValue.OfFloat(box.MinY), JsonValue.OfFloat(box.MinZ),
                JsonValue.OfFloat(box.MaxX), JsonValue.OfFloat(box.MaxY), JsonValue.OfFloat(box.MaxZ),
            });
            return JsonValue.OfObject(new JsonObject(
                new[] { "id", "length", "xxh3", "faces", "vertices", "bounds" },
                new[]
                {
                    JsonValue.OfInteger(row.Segment), JsonValue.OfInteger(row.Length), HashText(row.Xxh3),
                    JsonValue.OfInteger(row.Faces), JsonValue.OfInteger(row.Vertices), bounds,
                }));
        }

        private static uint Whole(JsonValue raw, string name)
        {
            try
            {
                return ExpectU32(raw[name]);
            }
            catch (RefusedException refused)
            {
                throw refused.Below(name);
            }
        }

        private static ulong HashOf(JsonValue raw)
        {
            try
            {
                return ExpectHash(raw["xxh3"]);
            }
            catch (RefusedException refused)
            {
                throw refused.Below("xxh3");
            }
        }

        private static Box BoundsOf(JsonValue raw)
        {
            if (raw.Kind != JsonKind.List || raw.Count != 6)
            {
                throw new RefusedException("got " + raw.Show() + ", expected six numbers", "bounds");
            }
            return new Box(Side(raw[0]), Side(raw[1]), Side(raw[2]), Side(raw[3]), Side(raw[4]), Side(raw[5]));
        }

        private static float Side(JsonValue raw)
        {
            double side;
            // What goes over the wire in msgpack is float32; the two subprotocols give the same numbers.
            if (raw.TryNumber(out side) && Math.Abs(side) <= WireLimits.MaxCoordinateM) return (float)side;
            throw new RefusedException(
                "got " + raw.Show() + ", expected a number of size at most " + WireLimits.MaxCoordinateM, "bounds");
        }

        // A NaN fails the comparison, an infinity too.
        private static bool IsCoordinate(float side)
        {
            return Math.Abs(side) <= WireLimits.MaxCoordinateM;
        }
    }
}
