using System;
using System.Collections.Generic;
using System.Linq;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>One landing that the user asked for; it may be sent several times, with a new generation each time.</summary>
    internal sealed class Landing
    {
        internal Landing(int number, Vec3 position, double radiusM, double? innerRadiusM, double? coarseRadiusM)
        {
            bool isRadius = radiusM > 0 && radiusM <= 1e6;
            bool isInner = innerRadiusM == null || (innerRadiusM > 0 && innerRadiusM <= radiusM);
            bool isCoarse = coarseRadiusM == null || (coarseRadiusM >= radiusM && coarseRadiusM <= 1e6);
            if (!position.IsFinite || !isRadius || !isInner || !isCoarse)
            {
                string radii = innerRadiusM + " <= " + radiusM + " <= " + coarseRadiusM;
                throw new ArgumentException("got a landing at " + position + " with radii " + radii
                    + ", expected a finite position and rising radii above 0, at most 1,000,000 m");
            }
            Number = number;
            Position = position;
            RadiusM = radiusM;
            InnerRadiusM = innerRadiusM;
            CoarseRadiusM = coarseRadiusM;
        }

        /// <summary>The session's own number, the same over generations.</summary>
        internal int Number { get; }

        internal Vec3 Position { get; }

        internal double RadiusM { get; }

        internal double? InnerRadiusM { get; }

        internal double? CoarseRadiusM { get; }

        /// <summary>The inner set is enough: the deadline has passed.</summary>
        internal bool IsUrgent;

        /// <summary>Generation of the message that was sent last; null while it waits to be sent.</summary>
        internal uint? Generation;

        internal Plan Plan;

        internal Ready Ready;

        /// <summary>Base faces that are hidden when it is shown: one bit each, the lowest bit first.</summary>
        internal byte[] Hidden = Array.Empty<byte>();

        /// <summary>The same for its inner set; null without one.</summary>
        internal byte[] InnerHidden;

        /// <summary>Keys of the plan that are neither whole in memory nor missing.</summary>
        internal readonly HashSet<ulong> Waiting = new HashSet<ulong>();

        /// <summary>Keys of <see cref="Waiting"/> that are being read from disk.</summary>
        internal readonly HashSet<ulong> Restoring = new HashSet<ulong>();

        /// <summary>Until the plan comes: keys that the request listed, and those that arrived since.</summary>
        internal readonly HashSet<ulong> Protected = new HashSet<ulong>();

        /// <summary>Number of failed deliveries by key.</summary>
        internal readonly Dictionary<ulong, int> Failures = new Dictionary<ulong, int>();

        /// <summary>Ids by key of segments that failed too often: later requests leave them out.</summary>
        internal readonly SortedDictionary<ulong, uint> GivenUp = new SortedDictionary<ulong, uint>();

        /// <summary>Payload bytes of the plan that were here already, or came since.</summary>
        internal long HereBytes;

        /// <summary>Keys that must not leave memory before it is shown.</summary>
        internal IEnumerable<ulong> Needs => Plan == null ? Protected : Plan.Show.Select(row => row.Key);

        /// <summary>The first rows of the plan that are not missing.</summary>
        internal List<PlanRow> ShownRows(int count = int.MaxValue)
        {
            var missing = new HashSet<ulong>(Ready?.Missing ?? Array.Empty<ulong>());
            return Plan.Show.Take(count).Where(row => !missing.Contains(row.Key)).ToList();
        }

        /// <summary>Wait to be sent again; what it has of its segments stays in memory.</summary>
        internal void AskAgain()
        {
            var needs = Needs.ToList();
            Protected.Clear();
            Protected.UnionWith(needs);
            Generation = null;
            Plan = null;
            Ready = null;
            Waiting.Clear();
            Restoring.Clear();
        }
    }
}
