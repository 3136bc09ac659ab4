using System;
using System.Collections.Generic;
using UnityEngine;
using UnityEngine.Events;

namespace Terraport.Unity
{
    /// <summary>
    /// The user's part in a group that visits a scene together: joins by name, lands where the guide lands the group, lands the group as the
    /// guide. Names and groups come from other people: show them as such.
    /// </summary>
    [AddComponentMenu("Terraport/Terraport Group")]
    [DisallowMultipleComponent]
    public sealed class TerraportGroup : MonoBehaviour
    {
        [SerializeField]
        [Tooltip("Empty: the scene on this object or above it.")]
        private TerraportScene scene;

        [SerializeField]
        [Tooltip("Takes the user along in the black of a fade. Empty: what is shown changes, and the user stays.")]
        private TerraportTeleport teleport;

        [SerializeField]
        [Tooltip("1 to 64 of A-Z a-z 0-9 _ . ~ -. Everyone who knows it and may see the scene can join.")]
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
        [Tooltip("The members, or where the group goes, have changed.")]
        private UnityEvent onChanged = new UnityEvent();

        [SerializeField]
        [Tooltip("The guide lands the group.")]
        private UnityEvent onCalled = new UnityEvent();

        [SerializeField]
        [Tooltip("Everybody is there, or the deadline has passed.")]
        private UnityEvent onGathered = new UnityEvent();

        // Null before the scene is loaded. The client is another one after the scene was closed and opened.
        private GroupFollower follower;
        private SceneClient client;

        /// <summary>The group as it is now, after every change; null without a seat.</summary>
        public event Action<Group> Changed;

        /// <summary>The guide lands the group there: in Unity's world, and metres of the scene.</summary>
        public event Action<Vector3, double> Called;

        /// <summary>The barrier of a group landing has opened: it says who has arrived.</summary>
        public event Action<GroupGathering> Gathered;

        /// <summary>A join or gather was refused: code of the protocol, and text for people.</summary>
        public event Action<string, string> Refused;

        /// <summary>The group as it is now; null without a seat.</summary>
        public Group Group => follower?.Group;

        /// <summary>Everybody in the group; empty without a seat.</summary>
        public IReadOnlyList<GroupMember> Members => Group?.Members ?? Array.Empty<GroupMember>();

        /// <summary>Whether the guide is followed. A member that does not may come later by <see cref="GoThere"/>.</summary>
        public bool Follows
        {
            get => follows;
            set {
                follows = value;
                if (follower != null) follower.Follows = value;
            }
        }

        /// <summary>Join the group of the inspector. False before the scene is loaded.</summary>
        public bool Join() { return Join(groupName, role, ownName); }

        /// <summary>Take a seat in a group; a seat held before is left. False before the scene is loaded.</summary>
        /// <exception cref="ArgumentException">A name that the protocol does not allow.</exception>
        public bool Join(string group, GroupRole asRole, string asName = null)
        {
            if (follower == null) return false;
            client.Group.Join(group, asRole, string.IsNullOrEmpty(asName) ? null : asName);
            RaiseChanged();
            return true;
        }

        /// <summary>Give the seat up.</summary>
        public void Leave()
        {
            if (follower == null) return;
            client.Group.Leave();
            RaiseChanged();
        }

        /// <summary>Land everybody at a point of Unity's world, as the guide; 0 takes the scene's radius. False without a seat.</summary>
        public bool Gather(Vector3 point, float radiusM = 0)
        {
            if (Group == null) return false;
            client.Group.Gather(scene.ToScene(point), radiusM > 0 ? radiusM : scene.DefaultRadiusM);
            return true;
        }

        /// <summary>Bring everybody to the newest landing. False without a seat, or before there was a landing.</summary>
        public bool GatherHere()
        {
            LandingStatus status = scene == null ? default : scene.Status;
            if (Group == null || status.Landing == 0) return false;
            client.Group.Gather(status.Position, status.RadiusM);
            return true;
        }

        /// <summary>Go where the group is, though that was not followed. False where it is nowhere.</summary>
        public bool GoThere() { return follower != null && follower.GoThere(); }

        private void OnEnable()
        {
            if (scene == null) scene = GetComponentInParent<TerraportScene>();
            if (scene == null)
            {
                Debug.LogWarning("terraport: this group has no scene", this);
                return;
            }
            scene.Loaded += OnLoaded;
            if (scene.Files != null) OnLoaded(scene.Files);
        }

        private void OnDisable()
        {
            if (scene == null) return;
            scene.Loaded -= OnLoaded;
            // Nobody would answer for this member any more. The seat of a scene that was closed went with it.
            if (client != null && scene.Client == client) client.Group.Leave();
            Detach();
        }

        private void LateUpdate()
        {
            if (follower != null && scene.Client == client) follower.Update();
        }

        private void OnLoaded(SceneFiles files)
        {
            // Raised again after a new version was published: the seat stays.
            if (scene.Client == client) return;
            Detach();
            client = scene.Client;
            follower = new GroupFollower(client) { Follows = follows };
            if (teleport != null) follower.Lander = TakeAlong;
            client.GroupChanged += OnChanged;
            client.GroupRefused += OnRefused;
            if (joinOnLoad && groupName.Length > 0) Join();
        }

        private void Detach()
        {
            if (client == null) return;
            client.GroupChanged -= OnChanged;
            client.GroupRefused -= OnRefused;
            follower.Detach();
            follower = null;
            client = null;
        }

        private int TakeAlong(GroupGathering gathering)
        {
            bool isGoing = teleport.TeleportTo(scene.ToWorld(gathering.Position));
            return isGoing ? scene.Status.Landing : client.Land(gathering.Position, gathering.RadiusM);
        }

        private void OnChanged(GroupChange change)
        {
            RaiseChanged();
            GroupGathering there = Group?.Gathering;
            if (change == GroupChange.Called && there != null)
            {
                Called?.Invoke(scene.ToWorld(there.Position), there.RadiusM);
                onCalled.Invoke();
            }
            else if (change == GroupChange.Gathered && there != null)
            {
                Gathered?.Invoke(there);
                onGathered.Invoke();
            }
        }

        private void OnRefused(string code, string message)
        {
            RaiseChanged();
            Refused?.Invoke(code, message);
        }

        private void RaiseChanged()
        {
            Changed?.Invoke(Group);
            onChanged.Invoke();
        }
    }
}
