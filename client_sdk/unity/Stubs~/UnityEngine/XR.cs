using System.Collections.Generic;

namespace UnityEngine
{
    public interface ISubsystem
    {
        bool running { get; }
    }

    public class IntegratedSubsystem : ISubsystem
    {
        public bool running => false;
    }

    /// <summary>Nothing is plugged in.</summary>
    public static class SubsystemManager
    {
        public static void GetSubsystems<T>(List<T> subsystems)
            where T : ISubsystem { subsystems.Clear(); }
    }
}

namespace UnityEngine.XR
{
    [System.Flags]
    public enum TrackingOriginModeFlags
    {
        Floor = 2,
    }

    public class XRInputSubsystem : IntegratedSubsystem
    {
        public bool TrySetTrackingOriginMode(TrackingOriginModeFlags origin) { return false; }
    }

    public enum XRNode
    {
        CenterEye = 2,
        LeftHand = 4,
        RightHand = 5,
    }

    public struct InputFeatureUsage<T>
    {
    }

    public static class CommonUsages
    {
        public static InputFeatureUsage<bool> triggerButton;
        public static InputFeatureUsage<Vector2> primary2DAxis;
        public static InputFeatureUsage<Vector3> devicePosition;
        public static InputFeatureUsage<Quaternion> deviceRotation;
    }

    /// <summary>Nothing is plugged in.</summary>
    public struct InputDevice
    {
        public bool TryGetFeatureValue(InputFeatureUsage<bool> usage, out bool value)
        {
            value = false;
            return false;
        }

        public bool TryGetFeatureValue(InputFeatureUsage<Vector2> usage, out Vector2 value)
        {
            value = default(Vector2);
            return false;
        }

        public bool TryGetFeatureValue(InputFeatureUsage<Vector3> usage, out Vector3 value)
        {
            value = default(Vector3);
            return false;
        }

        public bool TryGetFeatureValue(InputFeatureUsage<Quaternion> usage, out Quaternion value)
        {
            value = default(Quaternion);
            return false;
        }
    }

    public static class InputDevices
    {
        public static InputDevice GetDeviceAtXRNode(XRNode node) { return default(InputDevice); }
    }

    public class XRDisplaySubsystem : IntegratedSubsystem
    {
    }
}
