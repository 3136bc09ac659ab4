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
        // pending waits to be sent; sent was, and is kept until it is known whether all of it came.
        private Aim pending;
        private Aim sent;
        private long sentGeneration = -1;

        /// <summary>Whether an aim is to be sent.</summary>
        internal bool Waits => pending.IsSet;

        /// <summary>Check what an aim says; nothing is allocated where it is right, since it may come with every frame.</summary>
        /// <exception cref="ArgumentException">A number that the protocol does not allow.</exception>
        internal static void Check(Vec3 position, double radiusM, double? coarseRadiusM)
        {
            const double Max = WireLimits.MaxCoordinateM;
            bool isValid = radiusM > 0 && radiusM <= WireLimits.MaxRadiusM && Math.Abs(position.X) <= Max && Math.Abs(position.Y) <= Max
                && Math.Abs(position.Z) <= Max
                && (!coarseRadiusM.HasValue || (coarseRadiusM.Value >= radiusM && coarseRadiusM.Value <= WireLimits.MaxRadiusM));
            // The message's own check throws, with the field's name; only this rare path allocates it.
            if (!isValid) WireCodec.Check(new AimMessage { Position = position, RadiusM = radiusM, CoarseRadiusM = coarseRadiusM });
        }

        /// <summary>Note the newest one, in place of any that waits.</summary>
        internal void Note(Vec3 position, double radiusM, double? coarseRadiusM)
        {
            pending = new Aim { Position = position, RadiusM = radiusM, CoarseRadiusM = coarseRadiusM, IsSet = true };
        }

        /// <summary>
        /// The message to send now, under a generation of this connection, whose server allows so large a radius; an aim must wait.
        /// </summary>
        internal AimMessage Take(uint generation, double maxRadiusM)
        {
            sent = pending;
            pending = default(Aim);
            sentGeneration = generation;
            double? ringM = LandingState.RingOf(sent.RadiusM, sent.CoarseRadiusM, maxRadiusM);
            return new AimMessage { Generation = generation, Position = sent.Position, RadiusM = sent.RadiusM, CoarseRadiusM = ringM };
        }

        /// <summary>Forget it: the user has landed.</summary>
        internal void Clear()
        {
            pending = default(Aim);
            sent = default(Aim);
        }

        /// <summary>Forget it where it was refused: it would be again.</summary>
        internal void Refused(uint? generation)
        {
            if (generation.HasValue && generation.Value == sentGeneration) sent = default(Aim);
        }

        /// <summary>Send it anew on the next connection, unless all of it had come (7, rule 4).</summary>
        /// <param name="completedGeneration">Generation of the newest aim of which everything has come; -1 for none.</param>
        internal void ConnectionLost(long completedGeneration)
        {
            if (!pending.IsSet && sentGeneration != completedGeneration) pending = sent;
            sentGeneration = -1;
        }

        /// <summary>A value type: an aim may come with every frame.</summary>
        private struct Aim
        {
            internal Vec3 Position;
            internal double RadiusM;
            internal double? CoarseRadiusM;
            internal bool IsSet;
        }
    }
}
