using System;
using System.Collections.Generic;

namespace UnityEngine
{
    [Flags]
    public enum HideFlags
    {
        None = 0,
        DontSave = 52,
        HideAndDontSave = 61,
    }

#if UNITY_6000_3_OR_NEWER
    public struct EntityId
    {
        private readonly int id;
        internal EntityId(int id) { this.id = id; }
        public override int GetHashCode() { return id; }
    }
#endif

    /// <summary>Destroyed objects equal null, as in the engine.</summary>
    public class Object
    {
        private static readonly HashSet<Object> live = new HashSet<Object>();
        private static int lastId;
        private readonly int id = ++lastId;
        private bool isDestroyed;
        public Object() { live.Add(this); }

        /// <summary>Everything of a type that was made and not destroyed.</summary>
        [StubsOwn]
        public static List<T> LiveOf<T>()
            where T : Object
        {
            List<T> found = new List<T>();
            foreach (Object made in live)
            {
                T match = made as T;
                if (!ReferenceEquals(match, null))
                {
                    found.Add(match);
                }
            }
            return found;
        }

        public string name { get; set; }
        public HideFlags hideFlags { get; set; }

#if UNITY_6000_5_OR_NEWER
        [Obsolete("GetEntityId", true)]
#endif
        public int GetInstanceID()
        {
            return id;
        }

#if UNITY_6000_3_OR_NEWER
        public EntityId GetEntityId() { return new EntityId(id); }
#endif

        public static bool operator ==(Object x, Object y)
        {
            bool isXNull = ReferenceEquals(x, null) || x.isDestroyed;
            bool isYNull = ReferenceEquals(y, null) || y.isDestroyed;
            return isXNull || isYNull ? isXNull && isYNull : ReferenceEquals(x, y);
        }

        public static bool operator !=(Object x, Object y) { return !(x == y); }
        public override bool Equals(object other) { return this == (other as Object); }
        public override int GetHashCode() { return id; }
        public static void Destroy(Object obj) { DestroyImmediate(obj); }

        public static void DestroyImmediate(Object obj)
        {
            if (obj != null)
            {
                obj.OnDestroying();
                live.Remove(obj);
                obj.isDestroyed = true;
            }
        }

#if UNITY_6000_0_OR_NEWER
        [Obsolete("FindAnyObjectByType")]
#endif
        public static T FindObjectOfType<T>()
            where T : Object { return null; }

        public static T FindAnyObjectByType<T>()
            where T : Object { return null; }

        internal virtual void OnDestroying() {}
    }

    public class Component : Object
    {
        public GameObject gameObject { get; internal set; }
        public Transform transform => gameObject.transform;
        public T GetComponent<T>() { return gameObject.GetComponent<T>(); }
        public T[] GetComponents<T>() { return gameObject.GetComponents<T>(); }
        public T GetComponentInParent<T>() { return gameObject.GetComponent<T>(); }
    }

    public class Behaviour : Component
    {
        public bool enabled { get; set; } = true;
        public bool isActiveAndEnabled => enabled && gameObject.activeSelf;
    }

    /// <summary>Messages (OnEnable, Update) are sent by whoever runs the stubs, not by an engine.</summary>
    public class MonoBehaviour : Behaviour
    {
    }

    public enum PrimitiveType
    {
        Cylinder = 2,
    }

    public sealed class GameObject : Object
    {
        private readonly List<Component> components = new List<Component>();
        public GameObject() : this("") {}

        public GameObject(string name)
        {
            this.name = name;
            transform = AddComponent<Transform>();
        }

        public Transform transform { get; private set; }
        public int layer { get; set; }
        public bool activeSelf { get; private set; } = true;
        public static GameObject CreatePrimitive(PrimitiveType type) { return new GameObject(type.ToString()); }
        public void SetActive(bool value) { activeSelf = value; }

        public T AddComponent<T>()
            where T : Component
        {
            T made = Activator.CreateInstance<T>();
            made.gameObject = this;
            components.Add(made);
            return made;
        }

        public T GetComponent<T>()
        {
            T[] all = GetComponents<T>();
            return all.Length > 0 ? all[0] : default(T);
        }

        public T[] GetComponents<T>()
        {
            List<T> found = new List<T>();
            foreach (object component in components)
            {
                if (component is T)
                {
                    found.Add((T)component);
                }
            }
            return found.ToArray();
        }

        internal override void OnDestroying()
        {
            foreach (Component component in components.ToArray())
            {
                DestroyImmediate(component);
            }
        }
    }

    /// <summary>Without rotation and scale, and without a parent's place: what the tests need.</summary>
    public class Transform : Component
    {
        public Transform parent { get; private set; }
        public Vector3 position { get; set; }
        public Vector3 localPosition { get; set; }
        public Quaternion localRotation { get; set; }
        public Vector3 localEulerAngles { get; set; }
        public Vector3 forward => new Vector3(0, 0, 1);
        public Vector3 localScale { get; set; }
        public void RotateAround(Vector3 point, Vector3 axis, float angle) {}
        public void SetParent(Transform parent, bool worldPositionStays) { this.parent = parent; }
        public Vector3 TransformPoint(Vector3 position) { return position + this.position; }
        public Vector3 InverseTransformPoint(Vector3 position) { return position - this.position; }
        public Vector3 InverseTransformVector(Vector3 vector) { return vector; }
    }

    public static class Debug
    {
        public static void Log(object message) { Console.WriteLine(message); }
        public static void LogWarning(object message) { Console.WriteLine(message); }
        public static void LogWarning(object message, Object context) { Console.WriteLine(message); }
    }

    public static class Application
    {
        public static bool isPlaying => StubIsPlaying;

        [StubsOwn]
        public static bool StubIsPlaying { get; set; } = true;

        public static event Events.UnityAction onBeforeRender
        {
            add {}
            remove {}
        }

        public static bool isMobilePlatform => false;
        public static string unityVersion => "0.0.0 (stubs)";

        // Nothing is kept unless a test says where: a run begins as the first one.
        public static string temporaryCachePath => Environment.GetEnvironmentVariable("TERRAPORT_STUB_SAVED") ?? "/dev/null";
    }

    public static class Time
    {
        public static float unscaledDeltaTime => 0.02f;
        public static float realtimeSinceStartup => Environment.TickCount / 1000f;
    }
}
