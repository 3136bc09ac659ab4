using UnityEngine;

namespace Terraport.Samples
{
    /// <summary>
    /// Closes the eyes: a black shell round the camera that fades in and out. Put it on a small inside-out sphere (scale -0.5) below the
    /// camera, with an unlit transparent material.
    /// </summary>
    [RequireComponent(typeof(Renderer))]
    public sealed class Blinder : MonoBehaviour
    {
        private static readonly int ColourId = Shader.PropertyToID("_BaseColor");
        private static readonly int OldColourId = Shader.PropertyToID("_Color");

        [SerializeField]
        [Range(0.02f, 1)]
        [Tooltip("Seconds to black, and back.")]
        private float fadeS = 0.15f;

        private Renderer shell;
        private Material material;
        private bool isClosing;
        private float darkness;

        /// <summary>Whether the view is fully black: what changes now is not seen.</summary>
        public bool IsClosed => darkness >= 1;

        /// <summary>Begin to cover the view.</summary>
        public void Close() { isClosing = true; }

        /// <summary>Begin to uncover it.</summary>
        public void Open() { isClosing = false; }

        private void Awake()
        {
            shell = GetComponent<Renderer>();
            // A copy of its own, which has to be destroyed; the shared one may be on other objects.
            material = shell.material;
            shell.enabled = false;
        }

        private void OnDestroy() { Destroy(material); }

        private void Update()
        {
            // Unscaled: a paused game must not leave the user in the black.
            darkness = Mathf.MoveTowards(darkness, isClosing ? 1 : 0, Time.unscaledDeltaTime / fadeS);
            // A transparent shell that is fully clear would still cost a full screen of blending, twice.
            shell.enabled = darkness > 0;
            Color black = new Color(0, 0, 0, darkness);
            material.SetColor(material.HasProperty(ColourId) ? ColourId : OldColourId, black);
        }
    }
}
