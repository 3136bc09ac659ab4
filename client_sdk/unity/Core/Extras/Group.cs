using System;
using System.Collections.Generic;
using System.Linq;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>Part of a member in a group.</summary>
    public enum GroupRole
    {
        /// <summary>Is landed by the guide.</summary>
        Member,

        /// <summary>Lands the group; one at most.</summary>
        Guide,
    }

    /// <summary>One seat of a group.</summary>
    public sealed class GroupMember
    {
        /// <summary>Number in the group.</summary>
        public uint Member { get; internal set; }

        /// <summary>What it calls itself; null without a name. Text from other people.</summary>
        public string Name { get; internal set; }

        /// <summary>Guide or member.</summary>
        public GroupRole Role { get; internal set; }

        /// <summary>False where its connection is lost and its seat is kept.</summary>
        public bool IsPresent { get; internal set; }

        /// <summary>Centre of its last landing, scene frame; null before the first.</summary>
        public Vec3? Position { get; internal set; }
    }

    /// <summary>A landing of the whole group, and the members that arrived, once its barrier is open.</summary>
    public sealed class GroupGathering
    {
        /// <summary>Its number in the group.</summary>
        public uint Number { get; internal set; }

        /// <summary>Number of the member that asked for it.</summary>
        public uint Guide { get; internal set; }

        /// <summary>Centre, scene frame.</summary>
        public Vec3 Position { get; internal set; }

        /// <summary>Radius, metres.</summary>
        public double RadiusM { get; internal set; }

        /// <summary>Radius of the smaller set that counts as well, metres; null without.</summary>
        public double? InnerRadiusM { get; internal set; }

        /// <summary>Milliseconds until the barrier opens at the latest; null where it was open already.</summary>
        public long? LeftMs { get; internal set; }

        /// <summary>Whether the barrier is open.</summary>
        public bool IsOver { get; internal set; }

        /// <summary>Members that show their landing.</summary>
        public IReadOnlyList<uint> Ready { get; internal set; } = Array.Empty<uint>();

        /// <summary>Members that show their inner set.</summary>
        public IReadOnlyList<uint> Degraded { get; internal set; } = Array.Empty<uint>();

        /// <summary>Members that declined, or did not arrive in time.</summary>
        public IReadOnlyList<uint> Missing { get; internal set; } = Array.Empty<uint>();
    }

    /// <summary>The group that a client has a seat in.</summary>
    public sealed class Group
    {
        /// <summary>Its name.</summary>
        public string Name { get; internal set; }

        /// <summary>The client's own number in it.</summary>
        public uint Member { get; internal set; }

        /// <summary>The client's own role.</summary>
        public GroupRole Role { get; internal set; }

        /// <summary>Everybody, by ascending number.</summary>
        public IReadOnlyList<GroupMember> Members { get; internal set; } = Array.Empty<GroupMember>();

        /// <summary>The newest landing of the group; null before the first.</summary>
        public GroupGathering Gathering { get; internal set; }

        /// <summary>Whether a text can be the name of a group.</summary>
        internal static bool IsName(string name)
        {
            bool isShort = !string.IsNullOrEmpty(name) && name.Length <= 64;
            return isShort && name.All(c => c < 128 && (char.IsLetterOrDigit(c) || "_.~-".IndexOf(c) >= 0));
        }
    }

    /// <summary>What of a group has changed.</summary>
    internal enum GroupChange
    {
        Joined,
        Roster,
        Called,
        Gathered,
    }

    /// <summary>The client's seat in a group, over all connections of its session (protocol, section 10).</summary>
    internal sealed class GroupSession
    {
        // Unanswered gathers at most; then the oldest is refused here.
        private const int MaxGathers = 16;

        private readonly SessionCore session;
        private readonly ISessionEvents events;
        private readonly SortedDictionary<uint, byte[]> gathers = new SortedDictionary<uint, byte[]>();
        private uint request;
        private string name, ownName, seat;
        private GroupRole role;
        private bool isSeated;
        // The newest gathering, and what was said of the arrival there.
        private uint newest;
        private byte[] arrived;

        internal GroupSession(SessionCore session, ISessionEvents events)
        {
            this.session = session;
            this.events = events;
        }

        /// <summary>The group as it is now; null without a seat.</summary>
        internal Group Group { get; private set; }

        /// <summary>The group that the connection's address is to name; null for none.</summary>
        internal string Name => name;

        /// <summary>Take a seat; one that is held is given up.</summary>
        /// <exception cref="ArgumentException">A name that the protocol does not allow.</exception>
        internal int Join(string group, GroupRole asRole, string asName)
        {
            if (!Group.IsName(group)) throw new ArgumentException("got group " + group + ", expected 1 to 64 of A-Z a-z 0-9 _ . ~ -");
            if (asName != null && (asName.Length == 0 || asName.Length > 64))
                throw new ArgumentException("got a name of " + asName.Length + " characters, expected 1 to 64");
            Leave();
            name = group;
            role = asRole;
            ownName = asName;
            request = session.NextRequest();
            SayJoin();
            return (int)request;
        }

        /// <summary>Give the seat up.</summary>
        internal void Leave()
        {
            if (name != null) session.Say(ClientMessages.Leave());
            Reset();
        }

        /// <summary>Land the group, now or as soon as the seat is taken again.</summary>
        internal int Gather(Vec3 position, double radiusM)
        {
            if (!position.IsFinite || !(radiusM > 0)) throw new ArgumentException("got radius " + radiusM + ", expected above 0");
            uint number = session.NextRequest();
            gathers[number] = ClientMessages.Gather(number, position, radiusM);
            if (isSeated) session.Say(gathers[number]);
            if (gathers.Count > MaxGathers)
            {
                uint oldest = gathers.Keys.First();
                gathers.Remove(oldest);
                events.GroupRefused((int)oldest, "too_many", MaxGathers + " gathers wait for an answer already");
            }
            return (int)number;
        }

        /// <summary>Say that this member's part in a gathering is over: "ready", "degraded" or "declined".</summary>
        internal void Arrived(uint gathering, string state)
        {
            if (gathering != newest) return; // A newer one has replaced it.
            arrived = ClientMessages.Arrived(gathering, state);
            if (isSeated) session.Say(arrived);
        }

        /// <summary>Take the seat again on a connection that is open.</summary>
        internal void Connected(string groups)
        {
            if (name == null) return;
            if (groups != "none")
            {
                SayJoin();
                return;
            }
            uint refused = request;
            Reset();
            events.GroupRefused((int)refused, "group_refused", "no groups are served at this address");
        }

        internal void ConnectionLost() { isSeated = false; }

        /// <summary>Take an error; false where it is none of a group's.</summary>
        internal bool Refused(Error error)
        {
            uint answered = error.Request.Value;
            if (name != null && answered == request)
                Reset();
            else if (!gathers.Remove(answered))
                return false;
            events.GroupRefused((int)answered, error.Code, error.Message);
            return true;
        }

        /// <summary>Take a message of the group; others, and what crossed a leave, are skipped.</summary>
        internal void Receive(ServerMessage message)
        {
            if (message is Joined)
                OnJoined((Joined)message);
            else if (!isSeated)
                return;
            else if (message is Roster && ((Roster)message).Group == name)
            {
                Group.Members = ((Roster)message).Members;
                events.GroupChanged(GroupChange.Roster);
            }
            else if (message is Gathering)
                OnGathering((Gathering)message);
            else if (message is Gathered && ((Gathered)message).Number == newest && Group.Gathering != null)
            {
                var gathered = (Gathered)message;
                Group.Gathering.IsOver = true;
                Group.Gathering.Ready = gathered.Ready;
                Group.Gathering.Degraded = gathered.Degraded;
                Group.Gathering.Missing = gathered.Missing;
                events.GroupChanged(GroupChange.Gathered);
            }
        }

        private void SayJoin()
        {
            if (session.CanJoin) session.Say(ClientMessages.Join(request, name, role, ownName, seat));
        }

        private void OnJoined(Joined joined)
        {
            if (name == null || joined.Request != request) return;
            isSeated = true;
            if (joined.Seat != seat)
            {
                // A new seat, perhaps of a new service: its gatherings count from 1 again.
                newest = 0;
                arrived = null;
                Group = new Group();
            }
            seat = joined.Seat;
            Group.Name = name;
            Group.Member = joined.Member;
            Group.Role = joined.Role;
            // What was asked for while the connection was away.
            foreach (byte[] gather in gathers.Values) session.Say(gather);
            events.GroupChanged(GroupChange.Joined);
        }

        private void OnGathering(Gathering message)
        {
            if (message.Number == newest)
            {
                if (arrived != null && message.LeftMs.HasValue) session.Say(arrived);
                return;
            }
            newest = message.Number;
            arrived = null;
            // The guide's own request is answered by its gathering: requests are answered in order.
            gathers.Clear();
            Group.Gathering = new GroupGathering {
                Number = message.Number,
                Guide = message.Guide,
                Position = message.Position,
                RadiusM = message.RadiusM,
                InnerRadiusM = message.InnerRadiusM,
                LeftMs = message.LeftMs,
                IsOver = message.LeftMs == null,
            };
            events.GroupChanged(GroupChange.Called);
        }

        private void Reset()
        {
            name = ownName = seat = null;
            isSeated = false;
            Group = null;
            gathers.Clear();
            newest = 0;
            arrived = null;
        }
    }
}
