using System;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>
    /// Teleports the user on the same object during a fade: the landing is requested at once, the view fades to black, and in one black frame the
    /// new detail is shown and the rig set down.
    /// </summary>
    [AddComponentMenu("Terraport/Terraport Teleport")]
    [RequireComponent(typeof(TerraportUser))]
    [DisallowMultipleComponent]
    public sealed class TerraportTeleport : MonoBehaviour
    {
        [SerializeField]
        [Tooltip("Darken every camera. Off: a fade of your own, by Darkening and Lightening.")]
        private bool fadesCameras = true;

        [SerializeField]
        [Min(0)]
        [Tooltip("Seconds of each fade, to black and back.")]
        private float fadeS = 0.15f;

        [SerializeField]
        [Min(0)]
        [Tooltip("Longest time in black, seconds. Then the user is moved onto the base, and detail follows.")]
        private float maxDarkS = 6;

        private TerraportUser user;
        // Of the scene while a teleport is under way.
        private TerraportScene scene;
        private bool sceneAutoShow;
        private Phase phase = Phase.Idle;
        private float phaseS;
        // 0 for clear, 1 for black: a fade begins where the one before it was.
        private float darkness;
        private FadeCurtain curtain;

        private enum Phase
        {
            Idle,
            Darkening,
            // Dark, until the landing is shown, is refused, or maxDarkS have passed.
            Waiting,
            Lightening,
        }

        /// <summary>Begin to darken, within so many seconds.</summary>
        public event Action<float> Darkening;

        /// <summary>Begin to lighten, within so many seconds: the user was moved, or the landing was refused.</summary>
        public event Action<float> Lightening;

        /// <summary>Whether a teleport is under way.</summary>
        public bool IsTeleporting => phase != Phase.Idle;

        /// <summary>Go to a point of Unity's world. One that is under way is replaced. False before the scene is loaded.</summary>
        public bool TeleportTo(Vector3 point) { return Begin(() => user.LandAt(point)); }

        /// <summary>Go to a named region, where it is seen best. False before the scene is loaded, and where no region has that name.</summary>
        public bool TeleportToPlace(string label)
        {
            bool isKnown = user != null && user.Scene != null && user.Scene.FindPlace(label) != null;
            return isKnown && Begin(() => user.LandAtPlace(label));
        }

        private bool Begin(Action land)
        {
            TerraportScene target = user == null ? null : user.Scene;
            if (!isActiveAndEnabled || target == null || target.Files == null) return false;
            if (phase == Phase.Idle || phase == Phase.Lightening)
            {
                scene = target;
                sceneAutoShow = target.AutoShow;
                // What is shown changes only while the screen is black.
                target.AutoShow = false;
                land();
                Enter(Phase.Darkening);
            }
            else
            {
                land();
                phaseS = 0;
            }
            return true;
        }

        private void Awake() { user = GetComponent<TerraportUser>(); }

        private void OnDisable()
        {
            if (phase == Phase.Darkening || phase == Phase.Waiting) scene.AutoShow = sceneAutoShow;
            phase = Phase.Idle;
            SetDarkness(0);
            if (curtain != null)
            {
                curtain.Destroy();
                curtain = null;
            }
        }

        private void Update()
        {
            phaseS += Time.unscaledDeltaTime;
            switch (phase)
            {
                case Phase.Darkening:
                    Fade(1);
                    if (darkness >= 1) Enter(Phase.Waiting);
                    break;
                case Phase.Waiting: Wait(); break;
                case Phase.Lightening:
                    Fade(0);
                    if (darkness <= 0) Enter(Phase.Idle);
                    break;
                default: break;
            }
        }

        private void Wait()
        {
            if (scene == null || !scene.IsOpen)
            {
                user.Stay(); // It was closed meanwhile: there is nowhere to go.
            }
            else
            {
                // Shown in this frame or in the first in which it can be; the user is set down within it.
                scene.Show();
            }
            if (phaseS >= maxDarkS) user.ArriveNow();
            // Arrived; or refused, or replaced by another landing: then the rig stays where it is.
            if (!user.IsComing) Enter(Phase.Lightening);
        }

        private void Enter(Phase next)
        {
            phase = next;
            phaseS = 0;
            if (next == Phase.Darkening) Darkening?.Invoke(fadeS);
            if (next != Phase.Lightening) return;
            scene.AutoShow = sceneAutoShow;
            Lightening?.Invoke(fadeS);
        }

        private void Fade(float to)
        {
            float step = fadeS > 0 ? Time.unscaledDeltaTime / fadeS : 1;
            SetDarkness(to > darkness ? Math.Min(to, darkness + step) : Math.Max(to, darkness - step));
        }

        private void SetDarkness(float value)
        {
            darkness = value;
            if (curtain == null && fadesCameras && value > 0) curtain = new FadeCurtain();
            if (curtain != null) curtain.Darkness = value;
        }
    }
}
