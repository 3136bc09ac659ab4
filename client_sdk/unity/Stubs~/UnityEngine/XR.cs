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
    public class XRDisplaySubsystem : IntegratedSubsystem
    {
    }
}
