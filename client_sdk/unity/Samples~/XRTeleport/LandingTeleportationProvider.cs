using Terraport.Unity;
using UnityEngine;
#if TERRAPORT_XRI_3
using UnityEngine.XR.Interaction.Toolkit.Locomotion.Teleportation;
#else
using UnityEngine.XR.Interaction.Toolkit;
#endif

namespace Terraport.Samples
{
    /// <summary>
    /// A teleportation provider that lands: put it in the place of the rig's own. A teleport becomes a landing; where that is shown, the
    /// rig is set down as the toolkit does it.
    /// </summary>
    public sealed class LandingTeleportationProvider : TeleportationProvider
    {
        [SerializeField]
        [Tooltip("Lands during a fade, its user without a rig of its own; none teleports as the toolkit does.")]
        private TerraportTeleport landing;

        private TerraportUser user;
        private TeleportRequest waiting;
        private bool isWaiting;

        /// <inheritdoc/>
        public override bool QueueTeleportRequest(TeleportRequest teleportRequest)
        {
            if (landing != null && user == null)
            {
                user = landing.GetComponent<TerraportUser>();
                user.Arrived += OnArrived;
            }
            if (landing == null || !landing.TeleportTo(teleportRequest.destinationPosition))
            {
                return base.QueueTeleportRequest(teleportRequest);
            }
            // Kept until it is shown; a newer request takes its place, as a newer landing does.
            waiting = teleportRequest;
            isWaiting = true;
            return true;
        }

        private void OnArrived(Vector3 point)
        {
            if (!isWaiting)
            {
                return;
            }
            isWaiting = false;
            // The toolkit's own teleport, only to the survey's height.
            waiting.destinationPosition = point;
            base.QueueTeleportRequest(waiting);
        }
    }
}
