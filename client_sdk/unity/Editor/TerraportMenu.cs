using UnityEditor;
using UnityEngine;

namespace Terraport.Unity.Editor
{
    /// <summary>Entries of the menus GameObject and Create.</summary>
    public static class TerraportMenu
    {
        /// <summary>A scene with solid ground.</summary>
        [MenuItem("GameObject/Terraport/Scene", false, 10)]
        public static void CreateScene(MenuCommand command)
        {
            GameObject created = new GameObject("Terraport Scene");
            created.AddComponent<TerraportScene>();
            created.AddComponent<TerraportGroundCollider>();
            Attach(created, command);
        }

        /// <summary>A user of the scene that is there.</summary>
        [MenuItem("GameObject/Terraport/User", false, 11)]
        public static void CreateUser(MenuCommand command)
        {
            GameObject created = new GameObject("Terraport User");
            TerraportUser user = created.AddComponent<TerraportUser>();
            user.Scene = FindScene();
            Camera eye = Camera.main;
            if (eye != null)
            {
                user.Pointer = eye.transform;
                user.Rig = eye.transform.parent;
            }
            Attach(created, command);
        }

        private static TerraportScene FindScene()
        {
#if UNITY_2023_1_OR_NEWER
            return Object.FindAnyObjectByType<TerraportScene>();
#else
            return Object.FindObjectOfType<TerraportScene>();
#endif
        }

        private static void Attach(GameObject created, MenuCommand command)
        {
            GameObjectUtility.SetParentAndAlign(created, command.context as GameObject);
            Undo.RegisterCreatedObjectUndo(created, "Create " + created.name);
            Selection.activeGameObject = created;
        }
    }
}
