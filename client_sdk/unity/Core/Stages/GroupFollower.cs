using System;

namespace Terraport
{
    /// <summary>
    /// The user's part in a group: lands where the guide lands it, where that is wished, and tells the group how that went. Nobody is
    /// moved here: where the user stands is up to whoever listens.
    /// </summary>
    /// <remarks>
    /// Of the thread that draws, as the stage is: every event goes to <see cref="Handle"/> behind the stage's, and <see cref="Update"/>
    /// is called after the stage's.
    /// </remarks>
    public sealed class GroupFollower
    {
        private readonly ISceneStream stream;
        private readonly SceneStage stage;
        // The gathering that is landed for, and its landing; 0 where none is.
        private uint gathering;
        private int landing;
        private bool isDegradedTold;

        /// <summary>A follower without a group. Stream and stage stay the owner's.</summary>
        public GroupFollower(ISceneStream stream, SceneStage stage)
        {
            this.stream = stream;
            this.stage = stage;
            Follows = true;
        }

        /// <summary>
        /// Land where the guide does. Else the group is told that this member does not come, and <see cref="GoThere"/> may still be
        /// called.
        /// </summary>
        public bool Follows { get; set; }

        /// <summary>Lands there in place of the stage, with a teleport for instance; returns the landing's number. Null for the stage.</summary>
        public Func<GroupGathering, int> Lander { get; set; }

        /// <summary>The group as it is now; null without a seat.</summary>
        public GroupFacts Group { get; private set; }

        /// <summary>As <see cref="ISceneStream.JoinGroup"/>.</summary>
        public int Join(string group, GroupRole role, string ownName = null)
        {
            int request = stream.JoinGroup(group, role, ownName);
            Forget();
            return request;
        }

        /// <summary>As <see cref="ISceneStream.LeaveGroup"/>.</summary>
        public void Leave()
        {
            stream.LeaveGroup();
            Forget();
        }

        /// <summary>Land where the group is, though that was not followed. The landing's number; 0 where the group is nowhere.</summary>
        public int GoThere()
        {
            GroupGathering there = Group == null ? null : Group.Gathering;
            if (there == null) return 0;
            var options = new LandOptions();
            if (there.InnerRadiusM.HasValue)
            {
                options.InnerRadiusM = there.InnerRadiusM;
                // Less is no deadline that the protocol allows.
                options.DeadlineMs = Math.Max(1, there.LeftMs ?? 1);
            }
            landing = Lander != null ? Lander(there) : stage.Land(there.Position, there.RadiusM, options);
            gathering = there.Number;
            isDegradedTold = false;
            return landing;
        }

        /// <summary>Take an event of the stream; every one, in their order.</summary>
        public void Handle(ref StreamEvent next)
        {
            bool isOfGroup = next.Kind >= StreamEventKind.GroupJoined && next.Kind <= StreamEventKind.GroupRefused;
            if (!isOfGroup) return;
            Group = next.Group;
            if (Group == null) Forget();
            if (next.Kind != StreamEventKind.GroupCalled) return;
            gathering = 0;
            if (Follows)
                GoThere();
            else
                stream.Arrive(Group.Gathering.Number, GroupArrival.Declined);
        }

        /// <summary>Tell the group once the landing that it asked for can be shown, or comes to nothing.</summary>
        public void Update()
        {
            if (gathering == 0) return;
            LandingStatus status = stage.Status;
            if (status.Landing == landing && status.Phase == LandingPhase.DegradedPresentable && !isDegradedTold)
            {
                isDegradedTold = true;
                stream.Arrive(gathering, GroupArrival.Degraded);
            }
            bool isThere = status.Phase == LandingPhase.Presentable || status.Phase == LandingPhase.Shown;
            // A newer landing: its user went elsewhere.
            bool isOff = status.Landing != landing || status.Phase == LandingPhase.Refused;
            if (!isOff && !isThere) return;
            stream.Arrive(gathering, isOff ? GroupArrival.Declined : GroupArrival.Ready);
            gathering = 0;
        }

        private void Forget()
        {
            Group = null;
            gathering = 0;
        }
    }
}
