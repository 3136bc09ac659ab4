namespace Terraport
{
    /// <summary>
    /// The user's part in a group: lands where the guide lands the group, where the user wants that, and reports the arrival. It does not
    /// move the user.
    /// </summary>
    internal sealed class GroupFollower
    {
        private readonly SceneClient client;
        // The gathering that is landed for, and its landing; 0 where there is none.
        private uint gathering;
        private int landing;
        private bool isDegradedReported;

        internal GroupFollower(SceneClient client)
        {
            this.client = client;
            client.GroupChanged += OnChanged;
        }

        /// <summary>Land where the guide does. Otherwise this member declines.</summary>
        internal bool Follows { get; set; } = true;

        /// <summary>Lands there instead of the client, by a teleport for instance; returns the number of the landing.</summary>
        internal System.Func<GroupGathering, int> Lander { get; set; }

        /// <summary>The group as it is now; null without a seat.</summary>
        internal Group Group => client.Group.Group;

        /// <summary>Land where the group is; false where it is nowhere.</summary>
        internal bool GoThere()
        {
            GroupGathering there = Group?.Gathering;
            if (there == null) return false;
            var options = new LandOptions { InnerRadiusM = there.InnerRadiusM, DeadlineMs = there.LeftMs ?? 0 };
            landing = Lander != null ? Lander(there) : client.Land(there.Position, there.RadiusM, options);
            gathering = there.Number;
            isDegradedReported = false;
            return true;
        }

        /// <summary>Follow no longer.</summary>
        internal void Detach() { client.GroupChanged -= OnChanged; }

        /// <summary>Once per frame, after the client's update: report an arrival.</summary>
        internal void Update()
        {
            if (gathering == 0) return;
            LandingStatus status = client.Status;
            bool isThere = status.Phase == LandingPhase.Presentable || status.Phase == LandingPhase.Shown;
            // A newer landing: the user went elsewhere.
            bool isOff = status.Landing != landing || status.Phase == LandingPhase.Refused;
            if (status.Phase == LandingPhase.DegradedPresentable && !isOff && !isDegradedReported)
            {
                isDegradedReported = true;
                client.Group.Arrived(gathering, "degraded");
            }
            if (!isOff && !isThere) return;
            client.Group.Arrived(gathering, isOff ? "declined" : "ready");
            gathering = 0;
        }

        private void OnChanged(GroupChange change)
        {
            if (change != GroupChange.Called || Group == null) return;
            gathering = 0;
            if (Follows)
                GoThere();
            else
                client.Group.Arrived(Group.Gathering.Number, "declined");
        }
    }
}
