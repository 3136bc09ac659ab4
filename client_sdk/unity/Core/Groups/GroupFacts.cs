using System.Collections.Generic;

namespace Terraport
{
    /// <summary>The group that a session has a seat in, as it was when an event told of it. Never changed.</summary>
    public sealed class GroupFacts
    {
        private static readonly GroupMember[] Nobody = new GroupMember[0];

        internal GroupFacts(string name, uint member, GroupRole role)
        {
            Name = name;
            Member = member;
            Role = role;
            Members = Nobody;
        }

        /// <summary>Name that the members joined by.</summary>
        public string Name { get; }

        /// <summary>Own number in the group.</summary>
        public uint Member { get; }

        /// <summary>Own role.</summary>
        public GroupRole Role { get; }

        /// <summary>Everybody, ascending number; empty until the first list has come.</summary>
        public IReadOnlyList<GroupMember> Members { get; private set; }

        /// <summary>The newest landing of the group; null before the first.</summary>
        public GroupGathering Gathering { get; private set; }

        internal GroupFacts With(GroupMember[] members)
        {
            return new GroupFacts(Name, Member, Role) { Members = members, Gathering = Gathering };
        }

        internal GroupFacts With(GroupGathering gathering)
        {
            return new GroupFacts(Name, Member, Role) { Members = Members, Gathering = gathering };
        }
    }
}
