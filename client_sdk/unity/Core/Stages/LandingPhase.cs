namespace Terraport
{
    /// <summary>Where the newest landing stands.</summary>
    public enum LandingPhase
    {
        /// <summary>There was no landing.</summary>
        Idle,

        /// <summary>Asked for, and the server's plan has not come.</summary>
        Planning,

        /// <summary>Payload is on its way, being decoded or uploaded.</summary>
        Streaming,

        /// <summary>The inner part is drawable, past the deadline: a swap will show it.</summary>
        DegradedPresentable,

        /// <summary>All of it is drawable: a swap will show it.</summary>
        Presentable,

        /// <summary>Shown, all of it.</summary>
        Shown,

        /// <summary>The server said no; what is shown stays.</summary>
        Refused,
    }
}
