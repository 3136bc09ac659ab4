using System;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>
    /// A user who walks in a scene: aims along a ray, lands where it meets the ground, and is set down on the survey's own height.
    /// </summary>
    /// <remarks>
    /// Rays and feet meet what is shown, detail and base, by <see cref="TerraportScene.CastGround"/> and
    /// <see cref="TerraportScene.GroundAt"/>: no collider is needed. <see cref="TerraportTeleport"/> lands during a fade.
    /// </remarks>
    [AddComponentMenu("Terraport/Terraport User")]
    public sealed class TerraportUser : MonoBehaviour
    {
        // Over what rises before a foot, under what hangs over a head.
        private const double SearchAboveM = 1;

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
        [Tooltip("Layers of your own things that stop the pointer: walls, tables. The ground itself needs none.")]
        private LayerMask obstacles;

        [SerializeField]
        [Tooltip("Land at the rig's place as soon as the scene is loaded.")]
        private bool landAtStart = true;

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
            get => scene;
            set => scene = value;
        }

        /// <summary>What is moved on landing; null where something else does it.</summary>
        public Transform Rig
        {
            get => rig;
            set => rig = value;
        }

        /// <summary>Whose forward direction aims.</summary>
        public Transform Pointer
        {
            get => pointer;
            set => pointer = value;
        }

        /// <summary>Radius of landings, metres; 0 takes the scene's.</summary>
        public float RadiusM
        {
            get => radiusM;
            set => radiusM = value;
        }

        /// <summary>Layers of things that stop the pointer; the ground is none of them.</summary>
        public LayerMask Obstacles
        {
            get => obstacles;
            set => obstacles = value;
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
            if (scene == null || !scene.CastGround(ray, reachM, out GroundHit ground)
                || (obstacles.value != 0 && Physics.Raycast(ray, out RaycastHit obstacle, ground.Distance, obstacles.value)))
            {
                point = default(Vector3);
                return false;
            }
            point = ground.Point;
            scene.Aim(point, radiusM);
            return true;
        }

        /// <summary>
        /// Land at a point of Unity's world. The rig goes there in the frame in which the landing is shown, so nothing is seen to change
        /// around the user but by going there.
        /// </summary>
        public void LandAt(Vector3 point) { LandAt(point, radiusM); }

        /// <summary>
        /// Land at a named region, where it is seen best, with the radius that shows it; the rig keeps its turn. False where no region has
        /// that name, or the scene is not loaded.
        /// </summary>
        public bool LandAtPlace(string label)
        {
            Place place = scene == null ? null : scene.FindPlace(label);
            if (place == null) return false;
            LandAt(scene.ToWorld(place), (float)place.RadiusM);
            return true;
        }

        private void LandAt(Vector3 point, float metres)
        {
            target = scene.ToScene(point);
            isComing = true;
            landing = scene.Land(point, metres);
        }

        /// <summary>Forget a landing that is on its way: it may still be shown, but the rig stays.</summary>
        public void Stay() { isComing = false; }

        /// <summary>Go there now, onto what is shown; detail follows when it is there. Nothing where no landing is on its way.</summary>
        public void ArriveNow()
        {
            if (isComing)
            {
                isComing = false;
                Arrive();
            }
        }

        private void OnEnable()
        {
            if (scene == null)
            {
                // The usual set-up: the user is below the scene's object.
                scene = GetComponentInParent<TerraportScene>();
            }
            if (scene == null)
            {
                Debug.LogWarning("terraport: this user has no scene", this);
                return;
            }
            scene.Loaded += OnLoaded;
            scene.Shown += OnShown;
            scene.Failed += OnFailed;
            if (scene.Files != null) OnLoaded(scene.Files);
        }

        private void OnDisable()
        {
            if (scene != null)
            {
                scene.Loaded -= OnLoaded;
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

        private void OnShown(SceneSwap swap)
        {
            // 0: a base came, and no landing.
            if (swap.Landing == 0) return;
            if (landing > 0 && swap.Landing != landing)
            {
                Stay(); // Somebody else has landed since: what is sharp now is not around the target.
                return;
            }
            if (isComing)
            {
                isComing = false;
                Arrive();
            }
            else if (rig != null && landing > 0)
            {
                // The rest of it came: the feet stay on the ground, wherever the user has walked meanwhile.
                rig.position = OnGround(scene.ToScene(rig.position));
            }
        }

        private void OnFailed(TerraportException error)
        {
            // Another landing may be on its way; this one is over only where the scene says that it was refused.
            if (scene.Status.Phase == LandingPhase.Refused) Stay();
        }

        private void Arrive()
        {
            Vector3 point = OnGround(target);
            if (rig != null) rig.position = point;
            Arrived?.Invoke(point);
        }

        /// <summary>The ground that is shown at a place.</summary>
        private Vector3 OnGround(Vec3 place)
        {
            GroundHit ground;
            // From above the place: the base that was aimed at may lie below the detail that is shown by now.
            Vector3 from = scene.ToWorld(new Vec3(place.X, place.Y + SearchAboveM, place.Z));
            return scene.GroundAt(from, out ground) ? ground.Point : scene.ToWorld(place);
        }
    }
}
