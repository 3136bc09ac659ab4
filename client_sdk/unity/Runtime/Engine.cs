using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>What the engine does differently in play mode and in the editor.</summary>
    internal static class Engine
    {
        /// <summary>Destroy what this package made; nothing where it is gone already (a scene that is unloaded takes its objects along).</summary>
        public static void Destroy(Object target)
        {
            if (target == null)
            {
                return;
            }
            // Destroy waits for the end of the frame, which only play mode has.
            if (Application.isPlaying)
            {
                Object.Destroy(target);
            }
            else
            {
                Object.DestroyImmediate(target);
            }
        }
    }
}
