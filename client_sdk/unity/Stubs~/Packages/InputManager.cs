#if ENABLE_LEGACY_INPUT_MANAGER
namespace UnityEngine
{
    /// <summary>In Unity the class is always there, and throws where the old Input Manager is switched off: here it is missing then.</summary>
    public class Input
    {
        public static Vector3 mousePosition => default(Vector3);
        public static bool GetMouseButton(int button) { return false; }
        public static bool GetMouseButtonDown(int button) { return false; }
    }
}
#endif
