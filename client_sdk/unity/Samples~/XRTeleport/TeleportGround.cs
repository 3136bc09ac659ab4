using Terraport.Unity;
using UnityEngine;
#if TERRAPORT_XRI_3
using UnityEngine.XR.Interaction.Toolkit.Interactables;
#else
using UnityEngine.XR.Interaction.Toolkit;
#endif

namespace Terraport.Samples
{
    /// <summary>
    /// Beside a Teleportation Area on the scene's object: interactables look for their colliders when they are enabled, and the ground's
    /// come later. This enables the area once the ground is solid.
    /// </summary>
    [RequireComponent(typeof(TerraportGroundCollider))]
    public sealed class TeleportGround : MonoBehaviour
    {
        [SerializeField]
        [Tooltip("The area; disabled in the scene, enabled here.")]
        private XRBaseInteractable area;

        private TerraportGroundCollider ground;

        private void Awake()
        {
            ground = GetComponent<TerraportGroundCollider>();
            area.enabled = false;
        }

        private void Update()
        {
            if (area.enabled && !ground.IsComplete)
            {
                area.enabled = false; // Another version of the scene: its ground has other colliders.
            }
            else if (!area.enabled && ground.IsComplete)
            {
                // Set while it is disabled: the area registers its colliders when it is enabled.
                area.colliders.Clear();
                area.colliders.AddRange(GetComponents<MeshCollider>());
                area.enabled = true;
            }
        }
    }
}
