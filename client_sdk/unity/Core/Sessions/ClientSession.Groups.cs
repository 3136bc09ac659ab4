using System;
using Terraport.Wire;

namespace Terraport.Sessions
{
    /// <content>What a session does in a group.</content>
    public sealed partial class ClientSession
    {
        /// <summary>Ask for a seat in a group; the one held before is left.</summary>
        /// <returns>The request's number in the events.</returns>
        /// <exception cref="ArgumentException">A name that the protocol does not allow; nothing has changed.</exception>
        public int Join(string name, GroupRole role, string ownName = null)
        {
            JoinMessage join = JoinOf(requests + 1, name, role, ownName);
            requests++;
            group.Join(join, IsOpen);
            return requests;
        }

        /// <summary>Give the seat in the group up; nothing where there is none.</summary>
        public void Leave() { group.Leave(IsOpen); }

        /// <summary>Land the group, as its guide.</summary>
        /// <returns>The request's number in the events.</returns>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        public int Gather(Vec3 position, double radiusM, double? innerRadiusM = null, int? deadlineMs = null)
        {
            GatherMessage gather = GatherOf(requests + 1, position, radiusM, innerRadiusM, deadlineMs);
            requests++;
            group.Gather(gather);
            return requests;
        }

        /// <summary>Say how this member's part of a group landing ended; nothing where a newer one has come.</summary>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        public void Arrive(uint gathering, GroupArrival how) { group.Arrive(ArrivedOf(gathering, how)); }

        /// <exception cref="ArgumentException">A name that the protocol does not allow.</exception>
        internal static JoinMessage JoinOf(int request, string name, GroupRole role, string ownName)
        {
            var join = new JoinMessage {
                Request = (uint)request,
                Group = name,
                Role = role == GroupRole.Guide ? "guide" : "member",
                Name = ownName,
            };
            WireCodec.Check(join);
            return join;
        }

        /// <exception cref="ArgumentException">A number that the protocol does not allow.</exception>
        internal static GatherMessage GatherOf(int request, Vec3 position, double radiusM, double? innerRadiusM, int? deadlineMs)
        {
            var gather = new GatherMessage {
                Request = (uint)request,
                Position = position,
                RadiusM = radiusM,
                InnerRadiusM = innerRadiusM,
                DeadlineMs = deadlineMs,
            };
            WireCodec.Check(gather);
            return gather;
        }

        /// <exception cref="ArgumentException">A number that the protocol does not allow.</exception>
        internal static ArrivedMessage ArrivedOf(uint gathering, GroupArrival how)
        {
            string state = how == GroupArrival.Ready ? "ready" : how == GroupArrival.Degraded ? "degraded" : "declined";
            var arrived = new ArrivedMessage { Gathering = gathering, State = state };
            WireCodec.Check(arrived);
            return arrived;
        }
    }
}
