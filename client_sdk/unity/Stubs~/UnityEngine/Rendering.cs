using System;

namespace UnityEngine.Rendering
{
    public enum VertexAttribute
    {
        Position = 0,
        Normal = 1,
        Color = 3,
        TexCoord0 = 4,
    }

    public enum VertexAttributeFormat
    {
        Float32 = 0,
        SNorm8 = 3,
        UNorm16 = 4,
    }

    public struct VertexAttributeDescriptor
    {
        public VertexAttributeDescriptor(VertexAttribute attribute = VertexAttribute.Position,
            VertexAttributeFormat format = VertexAttributeFormat.Float32, int dimension = 3, int stream = 0)
        {
            this.attribute = attribute;
            this.format = format;
            this.dimension = dimension;
            this.stream = stream;
        }

        public VertexAttribute attribute { get; set; }
        public VertexAttributeFormat format { get; set; }
        public int dimension { get; set; }
        public int stream { get; set; }
    }

    public enum IndexFormat
    {
        UInt16 = 0,
        UInt32 = 1,
    }

    [Flags]
    public enum MeshUpdateFlags
    {
        Default = 0,
        DontValidateIndices = 1,
        DontResetBoneBounds = 2,
        DontNotifyMeshUsers = 4,
        DontRecalculateBounds = 8,
    }

    public struct SubMeshDescriptor
    {
        public SubMeshDescriptor(int indexStart, int indexCount, MeshTopology topology = MeshTopology.Triangles) : this()
        {
            this.indexStart = indexStart;
            this.indexCount = indexCount;
            this.topology = topology;
        }

        public Bounds bounds { get; set; }
        public MeshTopology topology { get; set; }
        public int indexStart { get; set; }
        public int indexCount { get; set; }
        public int firstVertex { get; set; }
        public int vertexCount { get; set; }
    }

    public enum ShadowCastingMode
    {
        Off = 0,
        TwoSided = 2,
    }

    public enum LightProbeUsage
    {
        Off = 0,
    }

    public enum ReflectionProbeUsage
    {
        Off = 0,
    }
}

namespace UnityEngine
{
    public enum MeshTopology
    {
        Triangles = 0,
    }

    public enum MotionVectorGenerationMode
    {
        Camera = 0,
    }

    public static class SystemInfo
    {
        public static int processorCount => Environment.ProcessorCount;
        public static int graphicsMemorySize => 4096;
        public static bool SupportsVertexAttributeFormat(Rendering.VertexAttributeFormat format, int dimension) { return true; }
    }

    public class Renderer : Component
    {
        public bool enabled { get; set; } = true;
        public Material material { get; set; }
        public Material sharedMaterial { get; set; }
        public Rendering.ShadowCastingMode shadowCastingMode { get; set; }
        public bool receiveShadows { get; set; }
        public Rendering.LightProbeUsage lightProbeUsage { get; set; }
        public Rendering.ReflectionProbeUsage reflectionProbeUsage { get; set; }
        public MotionVectorGenerationMode motionVectorGenerationMode { get; set; }
        public bool allowOcclusionWhenDynamic { get; set; }
    }

    public class MeshRenderer : Renderer
    {
    }

    public sealed class MeshFilter : Component
    {
        public Mesh sharedMesh { get; set; }
    }

    public sealed class Camera : Behaviour
    {
        public static Camera main => null;
        public Ray ScreenPointToRay(Vector3 pos) { return new Ray(pos, new Vector3(0, 0, 1)); }
    }

    public sealed class Shader : Object
    {
        public bool isSupported => true;
        public static int PropertyToID(string name) { return name.GetHashCode(); }
    }

    public sealed class Resources
    {
        public static T Load<T>(string path)
            where T : Object { return Activator.CreateInstance<T>(); }
    }

    public class Material : Object
    {
        private readonly System.Collections.Generic.Dictionary<int, float> floats = new System.Collections.Generic.Dictionary<int, float>();
        public Material(Shader shader) {}
        public Material(Material source) { renderQueue = source.renderQueue; }
        public int renderQueue { get; set; }
        public Texture mainTexture { get; set; }
        public Vector2 mainTextureScale { get; set; }
        public Vector2 mainTextureOffset { get; set; }
        public bool HasProperty(int nameID) { return true; }
        public bool HasProperty(string name) { return true; }
        public void SetFloat(int nameID, float value) { floats[nameID] = value; }

        public float GetFloat(int nameID)
        {
            float value;
            return floats.TryGetValue(nameID, out value) ? value : 0;
        }

        public void SetColor(int nameID, Color value) {}
    }

    public enum TextureWrapMode
    {
        Clamp = 1,
    }

    public enum FilterMode
    {
        Trilinear = 2,
    }

    public enum TextureFormat
    {
        RGBA32 = 4,
    }

    public class Texture : Object
    {
        public virtual int width { get; set; }
        public virtual int height { get; set; }
        public TextureWrapMode wrapMode { get; set; }
        public FilterMode filterMode { get; set; }
        public int anisoLevel { get; set; }
    }

    public sealed class Texture2D : Texture
    {
        public Texture2D(int width, int height, TextureFormat textureFormat, bool mipChain, bool linear)
        {
            this.width = width;
            this.height = height;
        }
    }

    /// <summary>Reads the size of a JPEG or PNG and nothing else.</summary>
    public static class ImageConversion
    {
        public static bool LoadImage(this Texture2D tex, byte[] data, bool markNonReadable)
        {
            if (data.Length > 24 && data[0] == 0x89)
            {
                tex.width = (data[18] << 8) | data[19];
                tex.height = (data[22] << 8) | data[23];
                return true;
            }
            for (int at = 2; at + 9 < data.Length && data[at] == 0xFF; at += 2 + ((data[at + 2] << 8) | data[at + 3]))
            {
                if (data[at + 1] == 0xC0 || data[at + 1] == 0xC2)
                {
                    tex.height = (data[at + 5] << 8) | data[at + 6];
                    tex.width = (data[at + 7] << 8) | data[at + 8];
                    return true;
                }
            }
            return false;
        }
    }
}
