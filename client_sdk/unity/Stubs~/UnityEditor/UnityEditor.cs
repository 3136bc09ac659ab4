using System;
using UnityEngine;

namespace UnityEditor
{
    [AttributeUsage(AttributeTargets.Class)]
    public sealed class InitializeOnLoadAttribute : Attribute
    {
    }

    [AttributeUsage(AttributeTargets.Method)]
    public class InitializeOnLoadMethodAttribute : Attribute
    {
    }

    public class EditorApplication
    {
        public delegate void CallbackFunction();
        public static CallbackFunction update;
    }

    public class SceneView
    {
        public static SceneView lastActiveSceneView => null;
        public Camera camera => null;
        public static void RepaintAll() {}
    }

    public sealed class CustomEditor : Attribute
    {
        public CustomEditor(Type inspectedType) {}
    }

    public sealed class MenuItem : Attribute
    {
        public MenuItem(string itemName, bool isValidateFunction, int priority) {}
    }

    public sealed class MenuCommand
    {
        public UnityEngine.Object context;
    }

    public class Editor
    {
        public UnityEngine.Object target { get; set; }
        public virtual void OnInspectorGUI() {}
        public virtual bool RequiresConstantRepaint() { return false; }
        public bool DrawDefaultInspector() { return false; }
    }

    public enum MessageType
    {
        Warning = 2,
    }

    public sealed class EditorGUILayout
    {
        public static void HelpBox(string message, MessageType type) {}
        public static void LabelField(string label, string label2, params GUILayoutOption[] options) {}
        public static void Space() {}
    }

    public sealed class GameObjectUtility
    {
        public static void SetParentAndAlign(GameObject child, GameObject parent) {}
    }

    public sealed class Undo
    {
        public static void RegisterCreatedObjectUndo(UnityEngine.Object objectToUndo, string name) {}
    }

    public sealed class Selection
    {
        public static GameObject activeGameObject { get; set; }
    }
}

namespace UnityEngine
{
    public sealed class GUILayoutOption
    {
    }
}
