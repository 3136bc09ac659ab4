using Terraport.Unity;
using UnityEngine;
#if ENABLE_INPUT_SYSTEM && TERRAPORT_INPUT_SYSTEM
using UnityEngine.InputSystem;
#endif

namespace Terraport.Samples
{
    /// <summary>
    /// Lands without XR: point with the mouse to aim, click to land, drag with the right button to look round. The prefab next to this has
    /// it, with a scene, a user and an eye.
    /// </summary>
    public sealed class FirstLanding : MonoBehaviour
    {
        [SerializeField]
        [Tooltip("The user who lands; it moves the rig that the eye is on.")]
        private TerraportUser user;

        [SerializeField]
        [Tooltip("Looks and aims; a child of the user's rig, at the height of a head.")]
        private Camera eye;

        [SerializeField]
        [Tooltip("Degrees that the view turns for a pixel of dragging.")]
        private float turnDegrees = 0.2f;

        private Vector3 draggedFrom;
        private float yawDegrees;
        private float pitchDegrees;

        private void OnEnable()
        {
            // From where it looks in the prefab; angles beyond half a turn are those to the other side.
            Vector3 angles = eye.transform.localEulerAngles;
            yawDegrees = angles.y;
            pitchDegrees = angles.x > 180 ? angles.x - 360 : angles.x;
            TerraportScene scene = user.Scene;
            scene.Planned += OnPlanned;
            scene.Shown += OnShown;
            scene.Failed += OnFailed;
#if !(ENABLE_INPUT_SYSTEM && TERRAPORT_INPUT_SYSTEM) && !ENABLE_LEGACY_INPUT_MANAGER
            Debug.LogWarning(
                "First landing: no mouse. Install the Input System (com.unity.inputsystem), or set Active Input Handling to Both.");
#endif
        }

        private void OnDisable()
        {
            TerraportScene scene = user.Scene;
            scene.Planned -= OnPlanned;
            scene.Shown -= OnShown;
            scene.Failed -= OnFailed;
        }

        private static void OnPlanned(PlanFacts plan)
        {
            Debug.Log("planned: " + plan.TotalTriangles + " triangles, " + (plan.LoadBytes >> 10) + " KiB to load");
        }

        private static void OnShown(SceneSwap swap) { Debug.Log("shown: landing " + swap.Landing); }

        private static void OnFailed(TerraportException error) { Debug.LogWarning(error.Code + ": " + error.Message); }

        private void Update()
        {
            Vector3 mouse;
            bool isTurning, isClicked;
            if (!TryReadMouse(out mouse, out isTurning, out isClicked))
            {
                return;
            }
            if (isTurning)
            {
                yawDegrees += (mouse.x - draggedFrom.x) * turnDegrees;
                pitchDegrees = Mathf.Clamp(pitchDegrees - (mouse.y - draggedFrom.y) * turnDegrees, -89, 89);
                eye.transform.localRotation = Quaternion.Euler(pitchDegrees, yawDegrees, 0);
            }
            draggedFrom = mouse;
            Vector3 point;
            // In every frame, clicked or not: aiming loads ahead, so that the click finds most of it here.
            if (user.TryAim(eye.ScreenPointToRay(mouse), out point) && isClicked)
            {
                user.LandAt(point);
            }
        }

        // By whichever input the project has switched on: Input throws in each frame where only the Input System is. Unity's own define says
        // what is switched on and ours, of the assembly definition, whether the package is installed; neither follows from the other.
#if ENABLE_INPUT_SYSTEM && TERRAPORT_INPUT_SYSTEM
        private static bool TryReadMouse(out Vector3 position, out bool isTurning, out bool isClicked)
        {
            Mouse mouse = Mouse.current;
            position = default(Vector3);
            isTurning = isClicked = false;
            if (mouse == null)
            {
                return false;
            }
            Vector2 pixel = mouse.position.ReadValue();
            position = new Vector3(pixel.x, pixel.y, 0);
            isTurning = mouse.rightButton.isPressed;
            isClicked = mouse.leftButton.wasPressedThisFrame;
            return true;
        }
#elif ENABLE_LEGACY_INPUT_MANAGER
        private static bool TryReadMouse(out Vector3 position, out bool isTurning, out bool isClicked)
        {
            position = Input.mousePosition;
            isTurning = Input.GetMouseButton(1);
            isClicked = Input.GetMouseButtonDown(0);
            return true;
        }
#else
        private static bool TryReadMouse(out Vector3 position, out bool isTurning, out bool isClicked)
        {
            position = default(Vector3);
            isTurning = isClicked = false;
            return false;
        }
#endif
    }
}
