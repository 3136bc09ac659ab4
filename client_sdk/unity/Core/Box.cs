using System;

namespace Terraport
{
    /// <summary>An axis-aligned box, metres, in float32 as payloads have it.</summary>
    internal readonly struct Box
    {
        internal readonly float MinX, MinY, MinZ, MaxX, MaxY, MaxZ;

        internal Box(float minX, float minY, float minZ, float maxX, float maxY, float maxZ)
        {
            MinX = minX;
            MinY = minY;
            MinZ = minZ;
            MaxX = maxX;
            MaxY = maxY;
            MaxZ = maxZ;
        }

        internal double DiagonalM => Length((double)MaxX - MinX, (double)MaxY - MinY, (double)MaxZ - MinZ);

        /// <summary>Distance from a point, in float64 as the service plans; 0 inside.</summary>
        internal double DistanceM(Vec3 point)
        {
            return Length(OutsideBy(point.X, MinX, MaxX), OutsideBy(point.Y, MinY, MaxY), OutsideBy(point.Z, MinZ, MaxZ));
        }

        private static double Length(double x, double y, double z) { return Math.Sqrt(x * x + y * y + z * z); }

        private static double OutsideBy(double coordinate, float min, float max)
        {
            return Math.Max(0, Math.Max(min - coordinate, coordinate - max));
        }
    }
}
