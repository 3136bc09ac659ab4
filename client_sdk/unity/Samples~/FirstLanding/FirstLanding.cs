using Terraport.Unity;
using UnityEngine;

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
            ground.AddComponent<TerraportGroundCollider>();
            user = ground.AddComponent<TerraportUser>();
            user.Scene = scene;
            user.Rig = new GameObject("Rig").transform;
            eye = Camera.main != null ? Camera.main : new GameObject("Eye").AddComponent<Camera>();
            eye.transform.SetParent(user.Rig, false);
            eye.transform.localPosition = new Vector3(0, EyeHeightM, 0);
            eye.nearClipPlane = 0.1f;
            eye.farClipPlane = 5000;
            scene.Planned += plan => Debug.Log("planned: " + plan.TotalTriangles + " triangles, " + (plan.LoadBytes >> 10) + " KiB to load");
            scene.Shown += swap => Debug.Log("shown: landing " + swap.Landing);
            scene.Failed += why => Debug.LogWarning(why.Code + ": " + why.Message);
            ground.SetActive(true);
        }

        private void Update()
        {
            Vector3 mouse = Input.mousePosition;
            if (Input.GetMouseButton(1))
            {
                yawDegrees += (mouse.x - draggedFrom.x) * turnDegrees;
                pitchDegrees = Mathf.Clamp(pitchDegrees - (mouse.y - draggedFrom.y) * turnDegrees, -89, 89);
                eye.transform.localRotation = Quaternion.Euler(pitchDegrees, yawDegrees, 0);
            }
            draggedFrom = mouse;
            Vector3 point;
            if (user.TryAim(eye.ScreenPointToRay(mouse), out point) && Input.GetMouseButtonDown(0))
            {
                user.LandAt(point);
            }
        }
    }
}
