using UnityEditor;
using UnityEngine;

namespace Terraport.Unity.Editor
{
    /// <summary>Entries of the menus GameObject and Create.</summary>
    public static class TerraportMenu
    {
        /// <summary>Create an object with a scene and its solid ground; undoable.</summary>
        [MenuItem("GameObject/Terraport/Scene", false, 10)]
        public static void CreateScene(MenuCommand command)
        {
            GameObject created = new GameObject("Terraport Scene");
            created.AddComponent<TerraportScene>();
            created.AddComponent<TerraportGroundCollider>();
            Attach(created, command);
        }

        /// <summary>Create a user of the open scene's first TerraportScene, aiming by the main camera; undoable.</summary>
        [MenuItem("GameObject/Terraport/User", false, 11)]
        public static void CreateUser(MenuCommand command)
        {
            GameObject created = new GameObject("Terraport User");
            TerraportUser user = created.AddComponent<TerraportUser>();
            user.Scene = FindScene();
            created.AddComponent<TerraportTeleport>();
            // A usual rig: the camera looks, its parent is moved.
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
            // As Unity's own entries do it: below what was clicked on, with undo, selected.
            GameObjectUtility.SetParentAndAlign(created, command.context as GameObject);
            Undo.RegisterCreatedObjectUndo(created, "Create " + created.name);
            Selection.activeGameObject = created;
        }
    }
}
