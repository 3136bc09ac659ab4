using System;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>What a device is asked to hold: the bounds of everything that can grow with the length of a visit.</summary>
    [Serializable]
    public sealed class DeviceBudgets
    {
        [Min(1000)]
        [Tooltip("Triangles of a landing at most. More: a larger sharp circle. Fewer: more frames per second.")]
        public int maxTriangles = 6000000;

        [Min(16)]
        [Tooltip("Graphics memory of everything, MiB, textures with their mips. More: denser surveys and photographs. Never more than a "
            + "quarter of what the device has.")]
        public int maxGpuMebibytes = 1024;

        [Min(1)]
        [Tooltip("Segments of a landing at most. Each one in view is a draw call.")]
        public int maxSegments = 4096;

        [Min(1)]
        [Tooltip("Radius of a landing unless another is asked for, metres.")]
        public float radiusM = 60;

        [Min(0)]
        [Tooltip("Payload kept in main memory, MiB. More: places landed in before come back without loading.")]
        public int cacheMebibytes = 256;

        [Min(0)]
        [Tooltip("Payload kept on disk from one run to the next, of all scenes, MiB; 0 keeps none. Other programs that can read the app's "
            + "cache can read it.")]
        public int diskMebibytes = 1024;

        [Min(1)]
        [Tooltip("Payload under way at most, MiB. More: long links are used in full. Less: a landing that is given up costs less.")]
        public int creditMebibytes = 16;

        /// <summary>The bounds of a class of devices; a copy. Auto and Custom give those of a desktop.</summary>
        public static DeviceBudgets For(DeviceProfile profile)
        {
            // The fields' own values are a desktop's.
            DeviceBudgets budgets = new DeviceBudgets();
            if (profile == DeviceProfile.Phone)
            {
                // An app that takes more than a few hundred MiB is closed by the phone's system, graphics memory included.
                budgets.maxTriangles = 1500000;
                budgets.maxSegments = 1024;
                budgets.radiusM = 40;
                budgets.cacheMebibytes = 48;
                budgets.diskMebibytes = 256;
                budgets.creditMebibytes = 4;
                budgets.maxGpuMebibytes = 256;
            }
            else if (profile == DeviceProfile.Headset)
            {
                // Two eyes, 72 times a second, on a phone's graphics: triangles are scarce, and draw calls; memory less so.
                budgets.maxTriangles = 900000;
                budgets.maxSegments = 512;
                budgets.radiusM = 40;
                budgets.cacheMebibytes = 96;
                budgets.diskMebibytes = 512;
                budgets.creditMebibytes = 8;
                budgets.maxGpuMebibytes = 512;
            }
            return budgets;
        }
    }
}
