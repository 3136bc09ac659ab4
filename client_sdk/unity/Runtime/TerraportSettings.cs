using System;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>How a scene is loaded and drawn. Read when it is opened.</summary>
    [Serializable]
    public sealed class TerraportSettings
    {
        /// <summary>A headset draws twice in 11 to 14 ms.</summary>
        private const float HeadsetFrameBudgetMs = 1.5f;

        private const float DefaultFrameBudgetMs = 3f;

        [Tooltip("Whose bounds. Auto: a mobile device in XR is a headset, another one a phone, everything else a desktop.")]
        public DeviceProfile profile = DeviceProfile.Auto;

        /// <summary>The bounds where the profile is Custom.</summary>
        public DeviceBudgets custom = new DeviceBudgets();

        [Range(0, 20)]
        [Tooltip("Milliseconds of a frame for uploads; 0 takes 1.5 in XR, else 3. More: landings are there sooner. Less: steadier frames.")]
        public float frameBudgetMs;

        [Range(0, 8)]
        [Tooltip("Threads that decode; 0 takes two, or one on a device with fewer than four processors. There are none in WebGL.")]
        public int decodeThreads;

        [Range(0, 1)]
        [Tooltip("How much of the shape's own light is laid over vertex colours. 0: the survey's colours as they are.")]
        public float relief = 0.35f;

        [Tooltip(
            "Take the project's lights, and cast and receive shadows (built-in pipeline and URP). Off: the survey's own light, cheapest.")]
        public bool lit;

        [Tooltip("Show a landing as soon as it can be shown. Off: call Show, for example in the black frame of a teleport.")]
        public bool autoShow = true;

        [Tooltip(
            "Around full detail show a ring of the coarser level, to three times the radius, where the scene has one. The bounds count "
            + "both; where there is no room for both the ring gives way.")]
        public bool showsCoarse = true;

        /// <summary>The profile that counts on this device.</summary>
        public DeviceProfile ActualProfile
        {
            get {
                // Read at each call, not stored: a headset may be connected after the scene was made.
                if (profile != DeviceProfile.Auto)
                {
                    return profile;
                }
                if (!Application.isMobilePlatform)
                {
                    return DeviceProfile.Desktop;
                }
                return Headset.IsLoaded ? DeviceProfile.Headset : DeviceProfile.Phone;
            }
        }

        /// <summary>The bounds that count on this device.</summary>
        public DeviceBudgets ActualBudgets => profile == DeviceProfile.Custom ? custom : DeviceBudgets.For(ActualProfile);

        /// <summary>The milliseconds that count at this moment.</summary>
        public float ActualFrameBudgetMs
        {
            get {
                if (frameBudgetMs > 0)
                {
                    return frameBudgetMs;
                }
                // By what is drawn to now: the same app may run with the headset taken off.
                return Headset.IsShowing ? HeadsetFrameBudgetMs : DefaultFrameBudgetMs;
            }
        }

        /// <summary>The number of threads that counts on this device.</summary>
        public int ActualDecodeThreads => decodeThreads > 0 ? decodeThreads : SystemInfo.processorCount < 4? 1 : 2;
    }
}
