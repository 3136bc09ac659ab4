using System;
using System.Threading.Tasks;
using Unity.Collections;
using UnityEngine;

namespace KtxUnity
{
    public enum ErrorCode
    {
        Success = 0,
    }

    public enum TextureOrientation
    {
        Unknown,
    }

    public static class TextureOrientationExtension
    {
        public static bool IsYFlipped(this TextureOrientation to) { return true; }
    }

    public class TextureResult
    {
        public Texture2D texture;
        public TextureOrientation orientation;
        public ErrorCode errorCode;
    }

    public class ManagedNativeArray : IDisposable
    {
        public ManagedNativeArray(byte[] original) {}
        public NativeArray<byte> nativeArray => default(NativeArray<byte>);
        public void Dispose() {}
    }

    public class KtxTexture
    {
        public Task<TextureResult> LoadFromBytes(
            NativeSlice<byte> data, bool linear = false, uint layer = 0, uint faceSlice = 0, uint mipLevel = 0, bool mipChain = true)
        {
            return Task.FromResult(new TextureResult());
        }
    }
}
