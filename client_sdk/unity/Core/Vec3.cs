using System;
using System.Globalization;

namespace Terraport
{
    /// <summary>
    /// A position or a direction in the scene frame: metres, right-handed, x east, y up, z south, about the scene's origin.
    /// </summary>
    public readonly struct Vec3 : IEquatable<Vec3>
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

        /// <summary>Whether no coordinate is NaN or infinite.</summary>
        public bool IsFinite
        {
            // The difference of a NaN or an infinity with itself is NaN.
            get { return X - X == 0 && Y - Y == 0 && Z - Z == 0; }
        }

        /// <inheritdoc/>
        public bool Equals(Vec3 other) { return X.Equals(other.X) && Y.Equals(other.Y) && Z.Equals(other.Z); }

        /// <inheritdoc/>
        public override bool Equals(object obj) { return obj is Vec3 && Equals((Vec3)obj); }

        /// <inheritdoc/>
        public override int GetHashCode()
        {
            unchecked { return ((X.GetHashCode() * 397) ^ Y.GetHashCode()) * 397 ^ Z.GetHashCode(); }
        }

        /// <summary>Coordinates with a dot, whatever the culture.</summary>
        public override string ToString() { return string.Format(CultureInfo.InvariantCulture, "({0:R}, {1:R}, {2:R})", X, Y, Z); }
    }
}
