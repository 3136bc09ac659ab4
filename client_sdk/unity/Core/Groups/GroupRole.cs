namespace Terraport
{
    /// <summary>What a member of a group may do.</summary>
    public enum GroupRole
    {
        /// <summary>Goes along, or does not.</summary>
        Member,

        /// <summary>Lands the group; there is one at most.</summary>
        Guide,
    }
}
