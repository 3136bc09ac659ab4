using System.Collections.Generic;
using Terraport.Unity;
using UnityEngine;
using UnityEngine.XR;

namespace Terraport.Samples
{
    /// <summary>
    /// A headset's rig without any package but the XR plug-in: moves head and hand by the tracked poses, aims while the trigger is held,
    /// lands when it is let go, turns by the stick. The prefab next to this has it, with a scene and a user.
    /// </summary>
    /// <remarks>
    /// Poses and buttons are read by UnityEngine.XR, which gives them whichever of the two input systems a project has switched on.
    /// </remarks>
    public sealed class HeadsetRig : MonoBehaviour
    {
        // A stick is pushed beyond the first, and let go below the second: else one push would turn twice.
        private const float Pushed = 0.7f;
        private const float Released = 0.3f;

        [SerializeField]
        [Tooltip("The user who aims by the hand and lands.")]
        private TerraportUser user;

        [SerializeField]
        [Tooltip("Lands during a fade.")]
        private TerraportTeleport teleport;

        [SerializeField]
        [Tooltip("What is on the ground: the parent of head and hand.")]
        private Transform rig;

        [SerializeField]
        [Tooltip("The camera.")]
        private Transform head;

        [SerializeField]
        [Tooltip("The controller that points.")]
        private Transform hand;

        [SerializeField]
        [Tooltip("Which hand it is: 5 the right one, 4 the left one.")]
        private XRNode handNode = XRNode.RightHand;

        [SerializeField]
        [Tooltip("Degrees that a push of the stick turns.")]
        private float turnDegrees = 30;

        private readonly List<XRInputSubsystem> inputs = new List<XRInputSubsystem>();
        private GameObject marker;
        private bool hasFloor;
        private bool isAiming;
        private bool isTurned;
        private bool hasPoint;
        private Vector3 point;

        private void OnEnable()
        {
            // Once more just before a picture is drawn: by then the head has moved on.
            Application.onBeforeRender += Track;
            marker = GameObject.CreatePrimitive(PrimitiveType.Cylinder);
            marker.transform.localScale = new Vector3(0.6f, 0.01f, 0.6f);
            Collider solid = marker.GetComponent<Collider>();
            if (solid != null)
            {
                solid.enabled = false;
            }
            marker.SetActive(false);
        }

        private void OnDisable()
        {
            Application.onBeforeRender -= Track;
            Destroy(marker);
        }

        private void Update()
        {
            AskForFloor();
            Track();
            InputDevice controller = InputDevices.GetDeviceAtXRNode(handNode);
            bool isHeld;
            controller.TryGetFeatureValue(CommonUsages.triggerButton, out isHeld);
            Aim(isHeld);
            Vector2 stick;
            controller.TryGetFeatureValue(CommonUsages.primary2DAxis, out stick);
            Turn(stick.x);
        }

        /// <summary>Poses of the play space; what is not tracked stays where the prefab has it.</summary>
        private void Track()
        {
            Place(head, InputDevices.GetDeviceAtXRNode(XRNode.CenterEye));
            Place(hand, InputDevices.GetDeviceAtXRNode(handNode));
        }

        private static void Place(Transform target, InputDevice device)
        {
            Vector3 position;
            Quaternion rotation;
            if (device.TryGetFeatureValue(CommonUsages.devicePosition, out position)
                && device.TryGetFeatureValue(CommonUsages.deviceRotation, out rotation))
            {
                target.localPosition = position;
                target.localRotation = rotation;
            }
        }

        /// <summary>Heights from the floor, so that the rig's own place is the feet's; asked for until a device says yes.</summary>
        private void AskForFloor()
        {
            if (hasFloor)
            {
                return;
            }
            SubsystemManager.GetSubsystems(inputs);
            foreach (XRInputSubsystem input in inputs)
            {
                hasFloor |= input.TrySetTrackingOriginMode(TrackingOriginModeFlags.Floor);
            }
        }

        private void Aim(bool isHeld)
        {
            if (isHeld)
            {
                hasPoint = user.TryAim(out point);
                marker.transform.position = point;
            }
            else if (isAiming && hasPoint)
            {
                teleport.TeleportTo(point);
            }
            isAiming = isHeld;
            hasPoint &= isHeld;
            marker.SetActive(hasPoint);
        }

        private void Turn(float push)
        {
            if (!isTurned && Mathf.Abs(push) > Pushed)
            {
                isTurned = true;
                // About the head: about the rig's middle the head would be carried sideways.
                rig.RotateAround(head.position, Vector3.up, push > 0 ? turnDegrees : -turnDegrees);
            }
            isTurned &= Mathf.Abs(push) > Released;
        }
    }
}
