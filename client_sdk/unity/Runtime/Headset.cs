using System.Collections.Generic;
using UnityEngine;
using UnityEngine.XR;

namespace Terraport.Unity
{
    /// <summary>
    /// Whether there is a headset, by the displays of the XR module: XRSettings is in the VR module, which is obsolete and, from Unity
    /// 6.5 on, gone.
    /// </summary>
    internal static class Headset
    {
        // Kept, since this is asked in every frame and must make no garbage.
        private static readonly List<XRDisplaySubsystem> displays = new List<XRDisplaySubsystem>();

        /// <summary>Whether an XR plug-in has loaded a display, shown on or not.</summary>
        public static bool IsLoaded
        {
            get {
                SubsystemManager.GetSubsystems(displays);
                return displays.Count > 0;
            }
        }

        /// <summary>Whether a display is drawn to at this moment.</summary>
        public static bool IsShowing
        {
            get {
                SubsystemManager.GetSubsystems(displays);
                foreach (XRDisplaySubsystem display in displays)
                {
                    if (display.running)
                    {
                        return true;
                    }
                }
                return false;
            }
        }
    }
}
