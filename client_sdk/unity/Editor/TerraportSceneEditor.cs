using System.Collections.Generic;
using UnityEditor;
using UnityEngine;

namespace Terraport.Unity.Editor
{
    /// <summary>Inspector of a scene: its fields, what is wrong with them, and while playing the state of the landing.</summary>
    [CustomEditor(typeof(TerraportScene))]
    public sealed class TerraportSceneEditor : UnityEditor.Editor
    {
        /// <inheritdoc/>
        public override bool RequiresConstantRepaint() { return Application.isPlaying; }

        /// <inheritdoc/>
        public override void OnInspectorGUI()
        {
            DrawDefaultInspector();
            TerraportScene scene = (TerraportScene)target;
            // At every repaint: a finding goes as soon as its cause does.
            List<string> findings = SettingsCheck.Findings(scene);
            foreach (string finding in findings)
            {
                EditorGUILayout.HelpBox(finding, MessageType.Warning);
            }
            if (Application.isPlaying && scene.IsOpen)
            {
                DrawState(scene);
            }
        }

        private static void DrawState(TerraportScene scene)
        {
            LandingStatus status = scene.Status;
            SceneFigures figures = scene.Figures;
            EditorGUILayout.Space();
            EditorGUILayout.LabelField("Link", scene.Link.Phase.ToString());
            EditorGUILayout.LabelField(
                "Landing", status.Landing + ": " + status.Phase + ", " + (status.Fraction * 100).ToString("0") + " %");
            EditorGUILayout.LabelField("Segments", figures.Segments.ToString());
            EditorGUILayout.LabelField("Triangles drawn", figures.DrawnTriangles.ToString("N0"));
            EditorGUILayout.LabelField("Payload received", (figures.Stream.PayloadBytes >> 20) + " MiB");
            EditorGUILayout.LabelField("Payload held", (figures.Stream.HeldBytes >> 20) + " MiB");
        }
    }
}
