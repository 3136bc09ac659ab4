namespace Terraport
{
    /// <summary>How a member's part of a group landing ended.</summary>
    public enum GroupArrival
    {
        /// <summary>Its landing can be shown, or is.</summary>
        Ready,

        /// <summary>Its inner part can be shown, the rest is coming.</summary>
        Degraded,

        /// <summary>It does not come: nobody waits for it.</summary>
        Declined,
    }
}
