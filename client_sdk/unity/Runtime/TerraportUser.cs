using System;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>
    /// Somebody who walks in a scene: aims along a ray, lands where it meets the ground, and is set down on the survey's own height.
    /// </summary>
    /// <remarks>
    /// The ground that rays meet is the base (<see cref="TerraportGroundCollider"/>). The height to stand on is asked of the server,
    /// which has all of the detail; until it answers, the base's counts.
    /// </remarks>
    [AddComponentMenu("Terraport/Terraport User")]
    public sealed class TerraportUser : MonoBehaviour
    {
        [SerializeField]
        [Tooltip("The scene to walk in.")]
        private TerraportScene scene;

        [SerializeField]
        [Tooltip(
            "What is moved on landing: the XR Origin, or a camera's parent. Its height is that of the ground. None: nothing is moved.")]
        private Transform rig;

        [SerializeField]
        [Tooltip("Whose forward direction aims: a controller, or the camera.")]
        private Transform pointer;

        [SerializeField]
        [Min(0)]
        [Tooltip("Radius of landings, metres; 0 takes the scene's.")]
        private float radiusM;

        [SerializeField]
        [Min(1)]
        [Tooltip("How far the pointer reaches, metres.")]
        private float reachM = 500;

        [SerializeField]
        [Tooltip("Land at the rig's place as soon as the scene is loaded.")]
        private bool landAtStart = true;

        // Number of the pick whose answer sets the height; 0 where none is awaited.
        private int pick;
        // Of the landing on its way; 0 where the scene keeps it until it is loaded.
        private int landing;
        private bool isComing;
        // Metres, scene frame: stays right when the scene's object is moved while the landing is on its way.
        private Vec3 target;

        /// <summary>The rig was set down; the argument is where, in Unity's world.</summary>
        public event Action<Vector3> Arrived;

        /// <summary>The scene to walk in; set it before the component is enabled.</summary>
        public TerraportScene Scene
        {
            get {
                return scene;
            }
            set {
                scene = value;
            }
        }

        /// <summary>What is moved on landing; null where something else does it.</summary>
        public Transform Rig
        {
            get {
                return rig;
            }
            set {
                rig = value;
            }
        }

        /// <summary>Whose forward direction aims.</summary>
        public Transform Pointer
        {
            get {
                return pointer;
            }
            set {
                pointer = value;
            }
        }

        /// <summary>Radius of landings, metres; 0 takes the scene's.</summary>
        public float RadiusM
        {
            get {
                return radiusM;
            }
            set {
                radiusM = value;
            }
        }

        /// <summary>Whether a landing of this user is on its way.</summary>
        public bool IsComing => isComing;

        /// <summary>Aim along the pointer. True, and where, if the ground is met; the scene then loads ahead. Call it in every frame.</summary>
        public bool TryAim(out Vector3 point)
        {
            Transform from = pointer != null ? pointer : transform;
            return TryAim(new Ray(from.position, from.forward), out point);
        }

        /// <summary>Aim along a ray of Unity's world. True, and where, if the ground is met; the scene then loads ahead.</summary>
        public bool TryAim(Ray ray, out Vector3 point)
        {
            RaycastHit hit;
            if (scene == null || !Physics.Raycast(ray, out hit, reachM))
            {
                point = default(Vector3);
                return false;
            }
            point = hit.point;
            scene.Aim(point, radiusM);
            return true;
        }

        /// <summary>
        /// Land at a point of Unity's world. The rig goes there in the frame in which the landing is shown, so nothing is seen to change
        /// around the user but by going there.
        /// </summary>
        public void LandAt(Vector3 point)
        {
            target = scene.ToScene(point);
            isComing = true;
            // Beside the landing: the height comes while payloads are still on their way.
            pick = scene.Pick(point);
            landing = scene.Land(point, radiusM);
        }

        /// <summary>Forget a landing that is on its way: it may still be shown, but the rig stays.</summary>
        public void Stay()
        {
            isComing = false;
            pick = 0;
        }

        private void OnEnable()
        {
            if (scene == null)
            {
                // The usual set-up: the user lies below the scene's object.
                scene = GetComponentInParent<TerraportScene>();
            }
            if (scene == null)
            {
                Debug.LogWarning("terraport: this user has no scene", this);
                return;
            }
            scene.Loaded += OnLoaded;
            scene.Picked += OnPicked;
            scene.Shown += OnShown;
            scene.Failed += OnFailed;
            if (scene.Files != null)
            {
                OnLoaded(scene.Files);
            }
        }

        private void OnDisable()
        {
            if (scene != null)
            {
                scene.Loaded -= OnLoaded;
                scene.Picked -= OnPicked;
                scene.Shown -= OnShown;
                scene.Failed -= OnFailed;
            }
            Stay();
        }

        private void OnLoaded(SceneFiles files)
        {
            if (landAtStart)
            {
                // Once: a new version of the scene must not move the user.
                landAtStart = false;
                LandAt(rig != null ? rig.position : transform.position);
            }
        }

        private void OnPicked(int request, PickHit hit)
        {
            // Answers to older picks, or to somebody else's.
            if (request != pick || hit == null)
            {
                return;
            }
            pick = 0;
            if (!isComing && rig != null)
            {
                target = scene.ToScene(rig.position); // Shown before the answer came: the user may have walked on meanwhile.
            }
            // The height alone: where exactly the user aimed must not slide along the ray.
            target = new Vec3(target.X, hit.Position.Y, target.Z);
            if (!isComing)
            {
                SetDown();
            }
        }

        private void OnShown(SceneSwap swap)
        {
            // 0: a base came, and no landing.
            if (!isComing || swap.Landing == 0)
            {
                return;
            }
            if (landing > 0 && swap.Landing != landing)
            {
                Stay(); // Somebody else has landed since: what is sharp now is not around the target.
                return;
            }
            isComing = false;
            SetDown();
        }

        private void OnFailed(TerraportException error)
        {
            // Another landing may be on its way; this one is over only where the scene says that it was refused.
            if (scene.Status.Phase == LandingPhase.Refused)
            {
                Stay();
            }
        }

        private void SetDown()
        {
            Vector3 point = scene.ToWorld(target);
            if (rig != null)
            {
                rig.position = point;
            }
            if (Arrived != null)
            {
                Arrived(point);
            }
        }
    }
}
