using System.Globalization;

namespace Terraport
{
    /// <summary>A position or a direction in the scene frame: metres, right-handed, x east, y up, z south, about the scene's origin.</summary>
    public readonly struct Vec3
    {
        /// <summary>East, metres.</summary>
        public readonly double X;

        /// <summary>Up, metres.</summary>
        public readonly double Y;

        /// <summary>South, metres: minus north.</summary>
        public readonly double Z;

        /// <summary>East, up and south, metres.</summary>
        public Vec3(double x, double y, double z)
        {
            X = x;
            Y = y;
            Z = z;
        }

        /// <summary>Whether no coordinate is NaN or infinite: the difference of such a number with itself is NaN.</summary>
        public bool IsFinite => X - X == 0 && Y - Y == 0 && Z - Z == 0;

        /// <summary>Sum of two vectors.</summary>
        public static Vec3 operator +(Vec3 a, Vec3 b) { return new Vec3(a.X + b.X, a.Y + b.Y, a.Z + b.Z); }

        /// <summary>Difference of two vectors.</summary>
        public static Vec3 operator -(Vec3 a, Vec3 b) { return new Vec3(a.X - b.X, a.Y - b.Y, a.Z - b.Z); }

        /// <summary>A vector that is longer by a factor.</summary>
        public static Vec3 operator *(double factor, Vec3 a) { return new Vec3(factor * a.X, factor * a.Y, factor * a.Z); }

        /// <summary>Coordinates with a dot, whatever the culture.</summary>
        public override string ToString() { return string.Format(CultureInfo.InvariantCulture, "({0:R}, {1:R}, {2:R})", X, Y, Z); }

        internal static double Dot(Vec3 a, Vec3 b) { return a.X * b.X + a.Y * b.Y + a.Z * b.Z; }

        internal static Vec3 Cross(Vec3 a, Vec3 b) { return new Vec3(a.Y * b.Z - a.Z * b.Y, a.Z * b.X - a.X * b.Z, a.X * b.Y - a.Y * b.X); }
    }
}
