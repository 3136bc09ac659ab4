using System.Collections.Generic;
using UnityEngine;

namespace Terraport.Unity
{
    /// <content>The base and a landing in the editor's scene view. What is made for it is neither saved nor selectable.</content>
    public sealed partial class TerraportScene
    {
        // Of the radius: so far the camera goes before the preview lands again.
        private const float MovedShare = 0.25f;

        private static readonly List<TerraportScene> InEditor = new List<TerraportScene>();

        // Of the preview's camera at its last landing.
        private Vector3? previewedAt;

        /// <summary>Scenes that are enabled while nothing is played: what the editor steps. Empty in a build.</summary>
        public static IReadOnlyList<TerraportScene> NotPlayed => InEditor;

        /// <summary>Whether base and a landing are shown in the editor's scene view while nothing is played; nothing of it is saved.</summary>
        public bool PreviewsInEditor
        {
            get => previewInEditor;
            set => previewInEditor = value;
        }

        /// <summary>
        /// One step of the preview, for the editor's own update: opens, lands below the camera where that has moved, closes when the preview
        /// was switched off. Does nothing while playing.
        /// </summary>
        /// <param name="camera">Place of the scene view's camera, Unity's world.</param>
        /// <returns>Whether what is drawn may have changed, so that views are to be drawn again.</returns>
        public bool StepPreview(Vector3 camera)
        {
            if (Application.isPlaying || !isActiveAndEnabled) return false;
            if (!previewInEditor || string.IsNullOrEmpty(sceneUrl))
            {
                bool wasOpen = IsOpen;
                ClosePreview();
                return wasOpen;
            }
            Open();
            long before = Figures.DrawnTriangles;
            Step();
            bool hasMoved = previewedAt == null || (camera - previewedAt.Value).magnitude > MovedShare * DefaultRadiusM;
            // Below the camera. Before the base is drawn there is no ground yet: the next step asks again.
            if (hasMoved && GroundAt(camera, out GroundHit ground))
            {
                previewedAt = camera;
                Land(ground.Point);
            }
            return Figures.DrawnTriangles != before;
        }

        private void BeginPreview()
        {
            if (!InEditor.Contains(this)) InEditor.Add(this);
        }

        /// <summary>Also before scripts are compiled and before play begins: Unity disables the component then.</summary>
        private void EndPreview()
        {
            InEditor.Remove(this);
            ClosePreview();
        }

        private void ClosePreview()
        {
            previewedAt = null;
            Close();
        }
    }
}
