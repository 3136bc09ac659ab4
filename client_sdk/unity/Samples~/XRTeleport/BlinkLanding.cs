using System;
using Terraport.Unity;
using UnityEngine;

namespace Terraport.Samples
{
    /// <summary>
    /// A landing inside a blink: the view goes black, the landing is shown in the black, the user is set down on the survey's own height,
    /// and the view comes back. Set the scene's <i>Auto Show</i> off.
    /// </summary>
    public sealed class BlinkLanding : MonoBehaviour
    {
        [SerializeField]
        [Tooltip("The scene to land in.")]
        private TerraportScene scene;

        [SerializeField]
        [Tooltip("Covers the view; none swaps without.")]
        private Blinder blinder;

        [SerializeField]
        [Min(0)]
        [Tooltip("Radius of landings, metres; 0 takes the scene's.")]
        private float radiusM;

        [SerializeField]
        [Range(0, 10)]
        [Tooltip("How long the view stays black at most, seconds. A landing that takes longer is shown around the user.")]
        private float patienceS = 1.5f;

        private Action<Vector3> arrive;
        private Vector3 point;
        private bool isShown;
        private int pick;
        private float sinceS;

        /// <summary>Begin to land; the one before is forgotten.</summary>
        /// <param name="at">Where, in Unity's world.</param>
        /// <param name="whenShown">Sets the user down at the point that it is given.</param>
        public void Begin(Vector3 at, Action<Vector3> whenShown)
        {
            point = at;
            arrive = whenShown;
            isShown = false;
            sinceS = 0;
            // Both asked for at once, while the view goes black.
            pick = scene.Pick(at);
            scene.Land(at, radiusM);
            if (blinder != null)
            {
                blinder.Close();
            }
        }

        private void OnEnable()
        {
            // Without Auto Show a landing waits for the black; in it, Show swaps.
            scene.Shown += OnShown;
            scene.Picked += OnPicked;
        }

        private void OnDisable()
        {
            scene.Shown -= OnShown;
            scene.Picked -= OnPicked;
            arrive = null;
            if (blinder != null)
            {
                blinder.Open();
            }
        }

        private void Update()
        {
            if (arrive == null)
            {
                return;
            }
            sinceS += Time.unscaledDeltaTime;
            if (blinder != null && !blinder.IsClosed)
            {
                return;
            }
            // In the black: shown in this frame where it can be, else in the first frame in which it can.
            if (!isShown)
            {
                scene.Show();
            }
            // Shown and the height known; or it takes too long, or was refused: nobody may be left in the dark.
            if ((isShown && pick == 0) || sinceS > patienceS || scene.Status.Phase == LandingPhase.Refused)
            {
                Action<Vector3> setDown = arrive;
                // Cleared first: setting the user down may begin the next landing.
                arrive = null;
                setDown(point);
                if (blinder != null)
                {
                    blinder.Open();
                }
            }
        }

        private void OnShown(SceneSwap swap) { isShown = isShown || swap.Landing > 0; }

        private void OnPicked(int request, PickHit hit)
        {
            if (request == pick)
            {
                pick = 0;
                // Nothing met: the base's own height has to do.
                point = hit == null ? point : scene.ToWorld(hit.Position);
            }
        }
    }
}
