using System.Collections.Generic;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>The base and a landing in the editor's scene view. What is made for it is neither saved nor selectable.</summary>
    public sealed partial class TerraportScene
    {
        // Of the radius: so far the camera goes before the preview lands anew.
        private const float MovedShare = 0.25f;

        private static readonly List<TerraportScene> InEditor = new List<TerraportScene>();

        // Of the preview's camera at its last landing; counts while hasPreviewed.
        private Vector3 previewedAt;
        private bool hasPreviewed;

        /// <summary>Scenes that are enabled while nothing is played: what the editor steps. Empty in a build.</summary>
        public static IReadOnlyList<TerraportScene> NotPlayed => InEditor;

        /// <summary>
        /// Whether base and a landing are shown in the editor's scene view while nothing is played; nothing of it is saved with the scene.
        /// </summary>
        public bool PreviewsInEditor
        {
            get {
                return previewInEditor;
            }
            set {
                previewInEditor = value;
            }
        }

        /// <summary>
        /// One step of the preview, for the editor's own update: opens, lands below the camera where that has moved, closes when the preview
        /// was switched off. Does nothing while playing.
        /// </summary>
        /// <param name="camera">Place of the scene view's camera, Unity's world.</param>
        /// <returns>Whether what is drawn may have changed, so that views are to be drawn anew.</returns>
        public bool StepPreview(Vector3 camera)
        {
            if (Application.isPlaying || !isActiveAndEnabled)
            {
                return false;
            }
            if (!previewInEditor || string.IsNullOrEmpty(sceneUrl))
            {
                bool wasOpen = session != null;
                ClosePreview();
                return wasOpen;
            }
            if (session == null)
            {
                Open();
            }
            long drawn = Figures.DrawnTriangles;
            Step();
            if (session != null && session.Stage != null)
            {
                // Below the camera, which mostly hangs high above the ground. Before the base is drawn there is none yet, and beside the
                // survey there is none at all: asked for again by the next step.
                GroundHit ground;
                bool hasMoved = !hasPreviewed || (camera - previewedAt).magnitude > MovedShare * DefaultRadiusM;
                if (hasMoved && GroundAt(camera, out ground))
                {
                    hasPreviewed = true;
                    previewedAt = camera;
                    Land(ground.Point);
                }
            }
            return Figures.DrawnTriangles != drawn;
        }

        private void BeginPreview()
        {
            if (!InEditor.Contains(this))
            {
                InEditor.Add(this);
            }
        }

        /// <summary>Also before scripts are compiled anew and before play begins: Unity disables the component then.</summary>
        private void EndPreview()
        {
            InEditor.Remove(this);
            ClosePreview();
        }

        private void ClosePreview()
        {
            hasPreviewed = false;
            Close();
        }
    }
}
