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
        [Tooltip("Lands; none teleports as the toolkit does.")]
        private BlinkLanding landing;

        private TeleportRequest waiting;

        /// <inheritdoc/>
        public override bool QueueTeleportRequest(TeleportRequest teleportRequest)
        {
            if (landing == null || !landing.isActiveAndEnabled)
            {
                return base.QueueTeleportRequest(teleportRequest);
            }
            // Kept until it is shown; a newer request takes its place, as a newer landing does.
            waiting = teleportRequest;
            landing.Begin(teleportRequest.destinationPosition, Arrive);
            return true;
        }

        private void Arrive(Vector3 point)
        {
            // The toolkit's own teleport, only to the survey's height.
            waiting.destinationPosition = point;
            base.QueueTeleportRequest(waiting);
        }
    }
}
