#if TERRAPORT_INPUT_SYSTEM
namespace UnityEngine.InputSystem
{
    public abstract class InputControl
    {
    }

    public abstract class InputControl<TValue> : InputControl
        where TValue : struct
    {
        public TValue ReadValue() { return default(TValue); }
    }

    public abstract class Pointer
    {
        public Controls.Vector2Control position { get; protected set; }
    }

    public class Mouse : Pointer
    {
        public static Mouse current { get; private set; }
        public Controls.ButtonControl leftButton { get; protected set; }
        public Controls.ButtonControl rightButton { get; protected set; }
    }
}

namespace UnityEngine.InputSystem.Controls
{
    public class Vector2Control : InputControl<Vector2>
    {
    }

    public class ButtonControl : InputControl<float>
    {
        public bool isPressed => false;
        public bool wasPressedThisFrame => false;
    }
}
#endif
