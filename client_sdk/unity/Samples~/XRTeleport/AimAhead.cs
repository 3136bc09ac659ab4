using Terraport.Unity;
using UnityEngine;
#if TERRAPORT_XRI_3
using UnityEngine.XR.Interaction.Toolkit.Interactors;
#else
using UnityEngine.XR.Interaction.Toolkit;
#endif

namespace Terraport.Samples
{
    /// <summary>
    /// Beside the ray interactor that teleports: what the ray meets is where the user may land next, so the scene loads ahead.
    /// </summary>
    [RequireComponent(typeof(XRRayInteractor))]
    public sealed class AimAhead : MonoBehaviour
    {
        [SerializeField]
        [Tooltip("The scene to land in.")]
        private TerraportScene scene;

        [SerializeField]
        [Min(0)]
        [Tooltip("Radius of landings, metres; 0 takes the scene's.")]
        private float radiusM;

        private XRRayInteractor ray;

        private void Awake() { ray = GetComponent<XRRayInteractor>(); }

        private void Update()
        {
            RaycastHit hit;
            // In every frame: the scene sends at most ten aims a second, and only the newest.
            if (scene != null && ray.isActiveAndEnabled && ray.TryGetCurrent3DRaycastHit(out hit))
            {
                scene.Aim(hit.point, radiusM);
            }
        }
    }
}
