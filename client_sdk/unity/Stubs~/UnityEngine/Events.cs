using System;

namespace UnityEngine.Events
{
    public delegate void UnityAction();

    public abstract class UnityEventBase
    {
    }

    public class UnityEvent : UnityEventBase
    {
        public void Invoke() {}
    }

    public class UnityEvent<T0> : UnityEventBase
    {
        public void Invoke(T0 arg0) {}
    }
}
