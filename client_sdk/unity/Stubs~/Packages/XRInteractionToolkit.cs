using System.Collections.Generic;
using UnityEngine;

#if TERRAPORT_XRI_3
namespace UnityEngine.XR.Interaction.Toolkit.Locomotion.Teleportation
#else
namespace UnityEngine.XR.Interaction.Toolkit
#endif
{
    public struct TeleportRequest
    {
        public Vector3 destinationPosition;
    }

    public class TeleportationProvider : MonoBehaviour
    {
        public virtual bool QueueTeleportRequest(TeleportRequest teleportRequest) { return true; }
    }
}

#if TERRAPORT_XRI_3
namespace UnityEngine.XR.Interaction.Toolkit.Interactors
#else
namespace UnityEngine.XR.Interaction.Toolkit
#endif
{
    public class XRRayInteractor : MonoBehaviour
    {
        public bool TryGetCurrent3DRaycastHit(out RaycastHit raycastHit)
        {
            raycastHit = default(RaycastHit);
            return false;
        }
    }
}

#if TERRAPORT_XRI_3
namespace UnityEngine.XR.Interaction.Toolkit.Interactables
#else
namespace UnityEngine.XR.Interaction.Toolkit
#endif
{
    public abstract class XRBaseInteractable : MonoBehaviour
    {
        public List<Collider> colliders { get; } = new List<Collider>();
    }
}
