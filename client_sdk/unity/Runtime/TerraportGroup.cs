using System;
using System.Collections.Generic;
using UnityEngine;
using UnityEngine.Events;

namespace Terraport.Unity
{
    /// <summary>
    /// The user's part in a group that visits a scene together: joins by name, lands where the guide lands everybody, lands everybody
    /// as the guide. Names and groups come from other people: show them as such.
    /// </summary>
    [AddComponentMenu("Terraport/Terraport Group")]
    [DisallowMultipleComponent]
    public sealed class TerraportGroup : MonoBehaviour
    {
        [SerializeField]
        [Tooltip("Empty: the scene on this object or above it.")]
        private TerraportScene scene;

        [SerializeField]
        [Tooltip("Takes the user along in the dark of a fade. Empty: what is shown changes, and the user stays.")]
        private TerraportTeleport teleport;

        [SerializeField]
        [Tooltip("1 to 64 of A-Z a-z 0-9 _ . ~ -. Who knows it and may see the scene can join.")]
        private string groupName = "";

        [SerializeField]
        [Tooltip("What the others see.")]
        private string ownName = "";

        [SerializeField]
        [Tooltip("The guide lands the group; there is one at most.")]
        private GroupRole role = GroupRole.Member;

        [SerializeField]
        [Tooltip("Join as soon as the scene is loaded.")]
        private bool joinOnLoad;

        [SerializeField]
        [Tooltip("Land where the guide does.")]
        private bool follows = true;

        [SerializeField]
        [Tooltip("Who is in the group, or where it goes, has changed.")]
        private UnityEvent onChanged = new UnityEvent();

        [SerializeField]
        [Tooltip("The guide lands the group.")]
        private UnityEvent onCalled = new UnityEvent();

        [SerializeField]
        [Tooltip("Everybody is there, or nobody waits any longer.")]
        private UnityEvent onGathered = new UnityEvent();

        private GroupFollower follower;
        // Whose stage the follower has: another one after the scene was closed and opened.
        private SceneStage stage;

        /// <summary>The group as it is now, after every change; null without a seat.</summary>
        public event Action<GroupFacts> Changed;

        /// <summary>The guide lands the group there: in Unity's world, and metres of the scene.</summary>
        public event Action<Vector3, double> Called;

        /// <summary>The barrier of a group landing has opened: who has arrived is told by it.</summary>
        public event Action<GroupGathering> Gathered;

        /// <summary>A join or gather was refused: code of the wire protocol, and for people.</summary>
        public event Action<string, string> Refused;

        /// <summary>The group as it is now; null without a seat.</summary>
        public GroupFacts Group => follower == null ? null : follower.Group;

        /// <summary>Everybody in the group; empty without a seat.</summary>
        public IReadOnlyList<GroupMember> Members => Group == null ? Array.Empty<GroupMember>() : Group.Members;

        /// <summary>Whether the guide is followed. Who does not is told apart, and may come later by <see cref="GoThere"/>.</summary>
        public bool Follows
        {
            get {
                return follows;
            }
            set {
                follows = value;
                if (follower != null)
                {
                    follower.Follows = value;
                }
            }
        }

        /// <summary>Join the group of the inspector. False before the scene is loaded.</summary>
        public bool Join() { return Join(groupName, role, ownName); }

        /// <summary>Take a seat in a group; a seat held before is left. False before the scene is loaded.</summary>
        /// <exception cref="ArgumentException">A name that the protocol does not allow.</exception>
        public bool Join(string group, GroupRole asRole, string asName = null)
        {
            if (follower == null)
            {
                return false;
            }
            follower.Join(group, asRole, string.IsNullOrEmpty(asName) ? null : asName);
            Tell();
            return true;
        }

        /// <summary>Give the seat up.</summary>
        public void Leave()
        {
            if (follower != null)
            {
                follower.Leave();
                Tell();
            }
        }

        /// <summary>Land everybody at a point of Unity's world, as the guide; 0 takes the scene's radius. False without a seat.</summary>
        public bool Gather(Vector3 point, float radiusM = 0)
        {
            if (Group == null)
            {
                return false;
            }
            scene.Stream.Gather(scene.ToScene(point), radiusM > 0 ? radiusM : scene.DefaultRadiusM);
            return true;
        }

        /// <summary>Bring everybody to where the newest landing is. False without a seat, or before there was a landing.</summary>
        public bool GatherHere()
        {
            LandingStatus status = scene == null ? default(LandingStatus) : scene.Status;
            if (Group == null || status.Landing == 0)
            {
                return false;
            }
            scene.Stream.Gather(status.Position, status.RadiusM);
            return true;
        }

        /// <summary>Go where the group is, though that was not followed. False where it is nowhere.</summary>
        public bool GoThere() { return follower != null && follower.GoThere() != 0; }

        private void OnEnable()
        {
            if (scene == null)
            {
                scene = GetComponentInParent<TerraportScene>();
            }
            if (scene == null)
            {
                Debug.LogWarning("terraport: this group has no scene", this);
                return;
            }
            scene.Loaded += OnLoaded;
            scene.Streamed += OnStreamed;
            if (scene.Files != null)
            {
                OnLoaded(scene.Files);
            }
        }

        private void OnDisable()
        {
            if (scene == null)
            {
                return;
            }
            scene.Loaded -= OnLoaded;
            scene.Streamed -= OnStreamed;
            // Nobody would answer for this member any more. Of a scene that was closed the seat went with it.
            if (follower != null && scene.Stage == stage)
            {
                follower.Leave();
            }
            follower = null;
            stage = null;
        }

        private void LateUpdate()
        {
            if (follower != null && scene.Stage == stage)
            {
                follower.Update();
            }
        }

        private void OnLoaded(SceneFiles files)
        {
            // Told again after a new version was published: the seat stays.
            if (follower != null && scene.Stage == stage)
            {
                return;
            }
            stage = scene.Stage;
            follower = new GroupFollower(scene.Stream, stage) { Follows = follows };
            if (teleport != null)
            {
                follower.Lander = TakeAlong;
            }
            if (joinOnLoad && groupName.Length > 0)
            {
                Join();
            }
        }

        private int TakeAlong(GroupGathering gathering)
        {
            bool isGoing = teleport.TeleportTo(scene.ToWorld(gathering.Position));
            return isGoing ? scene.Status.Landing : stage.Land(gathering.Position, gathering.RadiusM);
        }

        private void OnStreamed(ref StreamEvent next)
        {
            bool isOfGroup = next.Kind >= StreamEventKind.GroupJoined && next.Kind <= StreamEventKind.GroupRefused;
            if (follower == null || !isOfGroup)
            {
                return;
            }
            follower.Handle(ref next);
            Tell();
            switch (next.Kind)
            {
                case StreamEventKind.GroupCalled:
                    GroupGathering there = next.Group.Gathering;
                    if (Called != null)
                    {
                        Called(scene.ToWorld(there.Position), there.RadiusM);
                    }
                    onCalled.Invoke();
                    break;
                case StreamEventKind.GroupGathered:
                    if (Gathered != null)
                    {
                        Gathered(next.Group.Gathering);
                    }
                    onGathered.Invoke();
                    break;
                case StreamEventKind.GroupRefused:
                    if (Refused != null)
                    {
                        Refused(next.Code, next.Message);
                    }
                    break;
                default: break;
            }
        }

        private void Tell()
        {
            if (Changed != null)
            {
                Changed(Group);
            }
            onChanged.Invoke();
        }
    }
}
