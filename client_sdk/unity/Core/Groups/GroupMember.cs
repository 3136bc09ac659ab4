namespace Terraport
{
    /// <summary>Somebody in a group.</summary>
    public sealed class GroupMember
    {
        internal GroupMember(uint member, string name, GroupRole role, bool isPresent, Vec3? position)
        {
            Member = member;
            Name = name;
            Role = role;
            IsPresent = isPresent;
            Position = position;
        }

        /// <summary>Number in the group, never given again in it.</summary>
        public uint Member { get; }

        /// <summary>What it calls itself: text from a stranger, to be shown as such. Null where it has no name.</summary>
        public string Name { get; }

        /// <summary>A group has one guide at most.</summary>
        public GroupRole Role { get; }

        /// <summary>False where its connection is lost and its seat is kept.</summary>
        public bool IsPresent { get; }

        /// <summary>Centre of its last landing, metres of the scene frame; null before the first.</summary>
        public Vec3? Position { get; }
    }
}
