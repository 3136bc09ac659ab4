using System;

namespace Terraport
{
    /// <summary>An axis-aligned box in the scene frame, metres, in float32 as index and payloads have it.</summary>
    public readonly struct Box : IEquatable<Box>
    {
        /// <summary>Lowest x, metres.</summary>
        public readonly float MinX;

        /// <summary>Lowest y, metres.</summary>
        public readonly float MinY;

        /// <summary>Lowest z, metres.</summary>
        public readonly float MinZ;

        /// <summary>Highest x, metres.</summary>
        public readonly float MaxX;

        /// <summary>Highest y, metres.</summary>
        public readonly float MaxY;

        /// <summary>Highest z, metres.</summary>
        public readonly float MaxZ;

        /// <summary>Lowest and highest corner, metres.</summary>
        public Box(float minX, float minY, float minZ, float maxX, float maxY, float maxZ)
        {
            MinX = minX;
            MinY = minY;
            MinZ = minZ;
            MaxX = maxX;
            MaxY = maxY;
            MaxZ = maxZ;
        }

        /// <summary>The middle of the box, metres, scene frame; in float64, since the sum of two float32 may not fit one.</summary>
        public Vec3 Centre => new Vec3(((double)MinX + MaxX) / 2, ((double)MinY + MaxY) / 2, ((double)MinZ + MaxZ) / 2);

        /// <summary>
        /// Euclidean distance in metres from a point to the box in float64, 0 inside: the distance that landings are planned by.
        /// </summary>
        public double DistanceM(Vec3 point)
        {
            // In float64 as the server plans: rounding earlier would disagree with it on border segments.
            double x = OutsideBy(point.X, MinX, MaxX);
            double y = OutsideBy(point.Y, MinY, MaxY);
            double z = OutsideBy(point.Z, MinZ, MaxZ);
            return Math.Sqrt(x * x + y * y + z * z);
        }

        /// <inheritdoc/>
        public bool Equals(Box other)
        {
            // Equals and not ==: a NaN equals itself here, so that a box can be a key.
            return MinX.Equals(other.MinX) && MinY.Equals(other.MinY) && MinZ.Equals(other.MinZ) && MaxX.Equals(other.MaxX)
                && MaxY.Equals(other.MaxY) && MaxZ.Equals(other.MaxZ);
        }

        /// <inheritdoc/>
        public override bool Equals(object obj) { return obj is Box && Equals((Box)obj); }

        /// <inheritdoc/>
        public override int GetHashCode()
        {
            unchecked
            {
                int low = (MinX.GetHashCode() * 397 ^ MinY.GetHashCode()) * 397 ^ MinZ.GetHashCode();
                return ((low * 397 ^ MaxX.GetHashCode()) * 397 ^ MaxY.GetHashCode()) * 397 ^ MaxZ.GetHashCode();
            }
        }

        /// <summary>How far a coordinate lies outside an interval of one axis; 0 within. All in metres.</summary>
        private static double OutsideBy(double coordinate, float min, float max)
        {
            return coordinate < min ? min - coordinate : coordinate > max ? coordinate - max : 0;
        }
    }
}
