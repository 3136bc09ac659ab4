using UnityEditor;
using UnityEngine;

namespace Terraport.Unity.Editor
{
    /// <summary>
    /// Steps the previews of open scenes at the editor's pace, by the camera of the scene view that was used last. What they make goes when
    /// their component is disabled, which Unity does before it compiles scripts, closes a scene or begins to play.
    /// </summary>
    [InitializeOnLoad]
    public static class ScenePreview
    {
        static ScenePreview() { EditorApplication.update += Step; }

        private static void Step()
        {
            SceneView view = SceneView.lastActiveSceneView;
            if (view == null || view.camera == null)
            {
                return;
            }
            bool hasChanged = false;
            // Backwards: a scene may close itself, and leave the list.
            for (int at = TerraportScene.NotPlayed.Count - 1; at >= 0; at--)
            {
                hasChanged |= TerraportScene.NotPlayed[at].StepPreview(view.camera.transform.position);
            }
            if (hasChanged)
            {
                SceneView.RepaintAll();
            }
        }
    }
}
