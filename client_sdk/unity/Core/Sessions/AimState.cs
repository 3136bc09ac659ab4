using System;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <summary>
    /// The newest aim: noted, sent, and sent anew where a lost connection cut it short. Older aims are forgotten; so are all
    /// once the user lands.
    /// </summary>
    internal sealed class AimState
    {
        private Aim noted;
        private Aim sent;
        private long sentGeneration = -1;

        /// <summary>Whether an aim is to be sent.</summary>
        internal bool Waits => noted.IsThere;

        /// <summary>Check what an aim says; nothing is allocated where it is right, since it may come with every frame.</summary>
        /// <exception cref="ArgumentException">A number that the protocol does not allow.</exception>
        internal static void Check(Vec3 position, double radiusM)
        {
            const double Most = WireLimits.MaxCoordinateM;
            bool isRight = radiusM > 0 && radiusM <= WireLimits.MaxRadiusM && Math.Abs(position.X) <= Most && Math.Abs(position.Y) <= Most
                && Math.Abs(position.Z) <= Most;
            if (!isRight) WireCodec.Check(new AimMessage { Position = position, RadiusM = radiusM });
        }

        /// <summary>Note the newest one, in place of any that waits.</summary>
        internal void Note(Vec3 position, double radiusM) { noted = new Aim { Position = position, RadiusM = radiusM, IsThere = true }; }

        /// <summary>The message to send now, under a generation of this connection; an aim must wait.</summary>
        internal AimMessage Take(uint generation)
        {
            sent = noted;
            noted = default(Aim);
            sentGeneration = generation;
            return new AimMessage { Generation = generation, Position = sent.Position, RadiusM = sent.RadiusM };
        }

        /// <summary>Forget it: the user has landed.</summary>
        internal void Clear()
        {
            noted = default(Aim);
            sent = default(Aim);
        }

        /// <summary>Forget it where it was refused: it would be again.</summary>
        internal void Refused(uint? generation)
        {
            if (generation.HasValue && generation.Value == sentGeneration) sent = default(Aim);
        }

        /// <summary>Send it anew on the next connection, unless all of it had come (7, rule 4).</summary>
        /// <param name="done">Generation of the newest aim of which everything has come; -1 for none.</param>
        internal void ConnectionLost(long done)
        {
            if (!noted.IsThere && sentGeneration != done) noted = sent;
            sentGeneration = -1;
        }

        private struct Aim
        {
            internal Vec3 Position;
            internal double RadiusM;
            internal bool IsThere;
        }
    }
}
