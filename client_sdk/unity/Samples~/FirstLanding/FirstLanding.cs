using Terraport.Unity;
using UnityEngine;
#if ENABLE_INPUT_SYSTEM && TERRAPORT_INPUT_SYSTEM
using UnityEngine.InputSystem;
#endif

namespace Terraport.Samples
{
    /// <summary>
    /// The whole of it without XR: point with the mouse to aim, click to land, drag with the right button to look round. Put it on an
    /// empty object in an empty scene and press Play.
    /// </summary>
    public sealed class FirstLanding : MonoBehaviour
    {
        private const float EyeHeightM = 1.7f;

        [SerializeField]
        [Tooltip("Address of the scene: http(s)://host/scenes/ID.")]
        private string sceneUrl = "http://127.0.0.1:8080/scenes/quarry";

        [SerializeField]
        [Tooltip("Degrees that the view turns for a pixel of dragging.")]
        private float turnDegrees = 0.2f;

        private TerraportScene scene;
        private TerraportUser user;
        private Camera eye;
        private Vector3 draggedFrom;
        private float yawDegrees;
        private float pitchDegrees;

        private void Awake()
        {
            // Inactive meanwhile, so that nothing is opened before it is set up.
            GameObject ground = new GameObject("Ground");
            ground.SetActive(false);
            scene = ground.AddComponent<TerraportScene>();
            scene.SceneUrl = sceneUrl;
            // Solid ground is what the mouse's ray meets.
            ground.AddComponent<TerraportGroundCollider>();
            user = ground.AddComponent<TerraportUser>();
            user.Scene = scene;
            user.Rig = new GameObject("Rig").transform;
            eye = Camera.main != null ? Camera.main : new GameObject("Eye").AddComponent<Camera>();
            // The rig stands on the ground, the eye above it: landings move the rig alone.
            eye.transform.SetParent(user.Rig, false);
            eye.transform.localPosition = new Vector3(0, EyeHeightM, 0);
            eye.nearClipPlane = 0.1f;
            // A quarry is seen from rim to rim.
            eye.farClipPlane = 5000;
            scene.Planned += plan =>
                Debug.Log("planned: " + plan.TotalTriangles + " triangles, " + (plan.LoadBytes >> 10) + " KiB to load");
            scene.Shown += swap => Debug.Log("shown: landing " + swap.Landing);
            scene.Failed += error => Debug.LogWarning(error.Code + ": " + error.Message);
            ground.SetActive(true);
#if !(ENABLE_INPUT_SYSTEM && TERRAPORT_INPUT_SYSTEM) && !ENABLE_LEGACY_INPUT_MANAGER
            Debug.LogWarning(
                "First landing: no mouse. Install the Input System (com.unity.inputsystem), or set Active Input Handling to Both.");
#endif
        }

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
