// What examples/unity uses of Unity 6 (docs.unity3d.com, 6000.0; com.unity.render-pipelines.core 17.2) and
// of VRC Light Volumes 3 (REDSIM/VRCLightVolumes, Documentation), as their documentation declares it, with
// as much behind it as unity_run.cs needs.
using System;
using System.Collections;
using System.Collections.Generic;
using System.Globalization;
using System.Reflection;

namespace UnityEngine
{
    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
    }

    public struct Vector4
    {
        public float x, y, z, w;
        public Vector4(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
    }

    public class Object
    {
        public string name { get; set; }
        public static T[] FindObjectsOfType<T>() where T : Object { return new T[0]; }
        public static implicit operator bool(Object exists) { return exists != null; }
    }

    public class ScriptableObject : Object
    {
        public static T CreateInstance<T>() where T : ScriptableObject { return Activator.CreateInstance<T>(); }
    }

    public class Component : Object { }
    public class Behaviour : Component { public bool isActiveAndEnabled { get; internal set; } }
    public class MonoBehaviour : Behaviour { }
    public sealed class ExecuteAlways : Attribute { }

    public enum TextureFormat { RGBAHalf = 17, RGBAFloat = 20 }
    public enum TextureWrapMode { Repeat, Clamp, Mirror, MirrorOnce }
    public enum FilterMode { Point, Bilinear, Trilinear }

    public class Texture : Object
    {
        public TextureWrapMode wrapMode { get; set; }
        public FilterMode filterMode { get; set; }
    }

    public sealed class Texture3D : Texture
    {
        public Texture3D(int width, int height, int depth, TextureFormat textureFormat, bool mipChain)
        {
            Size = new[] { width, height, depth };
            Format = textureFormat;
        }
        public void SetPixelData<T>(T[] data, int mipLevel, int sourceDataStartIndex = 0)
        {
            Data = (byte[])(Array)data;
        }
        public void Apply(bool updateMipmaps = true, bool makeNoLongerReadable = false) { }

        internal readonly int[] Size;
        internal readonly TextureFormat Format;
        internal byte[] Data;
    }

    public sealed class Shader : Object
    {
        public static void SetGlobalTexture(string name, Texture value) { Globals[name] = value; }
        public static void SetGlobalVector(string name, Vector4 value) { Globals[name] = value; }

        internal static readonly Dictionary<string, object> Globals = new Dictionary<string, object>();
    }

    public class Debug
    {
        public static void LogError(object message) { Console.Error.WriteLine(message); }
    }

    // Fields of the type, by their names; numbers, strings, arrays and classes of these, no arrays of arrays.
    public static class JsonUtility
    {
        public static T FromJson<T>(string json)
        {
            int at = 0;
            return (T)Made(typeof(T), Value(json, ref at));
        }

        static object Made(Type type, object value)
        {
            if (value == null || type == typeof(string))
                return value as string;
            if (type.IsPrimitive)
                return Convert.ChangeType(value, type, CultureInfo.InvariantCulture);
            if (type.IsArray)
            {
                var from = (List<object>)value;
                Array array = Array.CreateInstance(type.GetElementType(), from.Count);
                for (int i = 0; i < from.Count; ++i)
                    array.SetValue(Made(type.GetElementType(), from[i]), i);
                return array;
            }
            object made = Activator.CreateInstance(type);
            foreach (KeyValuePair<string, object> pair in (Dictionary<string, object>)value)
            {
                FieldInfo field = type.GetField(pair.Key);
                if (field != null)
                    field.SetValue(made, Made(field.FieldType, pair.Value));
            }
            return made;
        }

        static char Next(string s, ref int at)
        {
            while (char.IsWhiteSpace(s[at]))
                ++at;
            return s[at];
        }

        static string Text(string s, ref int at)
        {
            int end = s.IndexOf('"', at + 1);
            string text = s.Substring(at + 1, end - at - 1);
            at = end + 1;
            return text;
        }

        static object Value(string s, ref int at)
        {
            char c = Next(s, ref at);
            if (c == '"')
                return Text(s, ref at);
            if (c == '{' || c == '[')
            {
                var fields = new Dictionary<string, object>();
                var items = new List<object>();
                for (++at; Next(s, ref at) != '}' && s[at] != ']';)
                {
                    if (s[at] == ',')
                    {
                        ++at;
                        Next(s, ref at);
                    }
                    if (c == '[')
                    {
                        items.Add(Value(s, ref at));
                        continue;
                    }
                    string key = Text(s, ref at);
                    Next(s, ref at);
                    ++at;
                    fields[key] = Value(s, ref at);
                }
                ++at;
                return c == '{' ? (object)fields : items;
            }
            int start = at;
            while (",]} \n".IndexOf(s[at]) < 0)
                ++at;
            string word = s.Substring(start, at - start);
            return word == "true" || word == "false" ? (object)(word == "true")
                                                     : double.Parse(word, CultureInfo.InvariantCulture);
        }
    }
}

namespace Unity.Collections
{
    public enum Allocator { Invalid, None, Temp, TempJob, Persistent }
    public enum NativeArrayOptions { UninitializedMemory, ClearMemory }

    public struct NativeArray<T> : IDisposable, IEnumerable<T> where T : struct
    {
        T[] array;
        public NativeArray(int length, Allocator allocator, NativeArrayOptions options = NativeArrayOptions.ClearMemory)
        {
            array = new T[length];
        }
        public NativeArray(T[] array, Allocator allocator) { this.array = (T[])array.Clone(); }
        public bool IsCreated { get { return array != null; } }
        public int Length { get { return array.Length; } }
        public T this[int index] { get { return array[index]; } set { array[index] = value; } }
        public T[] ToArray() { return (T[])array.Clone(); }
        public void CopyFrom(T[] from)
        {
            if (from.Length != array.Length)
                throw new ArgumentException("source and destination length must be the same");
            from.CopyTo(array, 0);
        }
        public void Dispose() { array = null; }
        public IEnumerator<T> GetEnumerator() { return ((IEnumerable<T>)array).GetEnumerator(); }
        IEnumerator IEnumerable.GetEnumerator() { return array.GetEnumerator(); }
    }
}

namespace UnityEngine.Rendering
{
    using Unity.Collections;

    public struct SphericalHarmonicsL2
    {
        float[] values;
        public float this[int rgb, int coefficient]
        {
            get { return values == null ? 0 : values[rgb * 9 + coefficient]; }
            set { (values ?? (values = new float[27]))[rgb * 9 + coefficient] = value; }
        }
    }

    public class AdaptiveProbeVolumes
    {
        public abstract class LightingBaker : IDisposable
        {
            public virtual bool isThreadSafe { get { return false; } }
            public static bool cancel { get; internal set; }
            public abstract ulong currentStep { get; }
            public abstract ulong stepCount { get; }
            public abstract NativeArray<SphericalHarmonicsL2> irradiance { get; }
            public abstract NativeArray<float> validity { get; }
            public abstract NativeArray<Vector4> occlusion { get; }
            public abstract void Initialize(bool bakeProbeOcclusion, NativeArray<Vector3> probePositions);
            public abstract void Initialize(bool bakeProbeOcclusion, NativeArray<Vector3> probePositions,
                                            NativeArray<uint> bakedRenderingLayerMasks);
            public abstract bool Step();
            public abstract void Dispose();
        }

        public static void SetLightingBakerOverride(LightingBaker baker) { Baker = baker; }

        internal static LightingBaker Baker;
    }
}

namespace UnityEditor
{
    using UnityEngine;

    public sealed class MenuItem : Attribute { public MenuItem(string itemName) { } }

    public class EditorWindow : ScriptableObject
    {
        public static T GetWindow<T>(string title) where T : EditorWindow { return CreateInstance<T>(); }
    }

    public class EditorPrefs
    {
        public static string GetString(string key, string defaultValue)
        {
            string value;
            return Values.TryGetValue(key, out value) ? value : defaultValue;
        }
        public static void SetString(string key, string value) { Values[key] = value; }

        static readonly Dictionary<string, string> Values = new Dictionary<string, string>();
    }

    public class GUILayoutOption { }
    public class EditorGUILayout
    {
        public static string TextField(string label, string text, params GUILayoutOption[] options) { return text; }
    }

    public class AssetImporter : Object { public string assetPath { get; internal set; } }

    public class AssetPostprocessor
    {
        public string assetPath { get; set; }
        public AssetImporter assetImporter { get; internal set; }
    }

    public class AssetDatabase
    {
        public static T LoadAssetAtPath<T>(string assetPath) where T : Object
        {
            Object asset;
            return Assets.TryGetValue(assetPath, out asset) ? asset as T : null;
        }
        public static Type GetImporterOverride(string path)
        {
            Type type;
            return Overrides.TryGetValue(path, out type) ? type : null;
        }
        public static void SetImporterOverride<T>(string path) where T : AssetImporters.ScriptedImporter
        {
            Overrides[path] = typeof(T);
        }

        internal static readonly Dictionary<string, Object> Assets = new Dictionary<string, Object>();
        internal static readonly Dictionary<string, Type> Overrides = new Dictionary<string, Type>();
    }

    public enum TextureImporterShape { Texture2D = 1, TextureCube = 2, Texture2DArray = 4, Texture3D = 8 }
    public enum TextureImporterNPOTScale { None, ToNearest, ToLarger, ToSmaller }
    public enum TextureImporterCompression { Uncompressed, Compressed, CompressedHQ, CompressedLQ }

    public sealed class TextureImporterSettings
    {
        public TextureImporterShape textureShape { get; set; }
        public int flipbookColumns { get; set; }
        public int flipbookRows { get; set; }
        public bool sRGBTexture { get; set; }
        public bool mipmapEnabled { get; set; }
        public TextureImporterNPOTScale npotScale { get; set; }
        public TextureWrapMode wrapMode { get; set; }
        public FilterMode filterMode { get; set; }
    }

    public class TextureImporter : AssetImporter
    {
        public TextureImporterCompression textureCompression { get; set; }
        public void ReadTextureSettings(TextureImporterSettings dest) { }
        public void SetTextureSettings(TextureImporterSettings src) { Settings = src; }

        internal TextureImporterSettings Settings;
    }
}

namespace UnityEditor.AssetImporters
{
    using UnityEngine;

    [AttributeUsage(AttributeTargets.Class, Inherited = false)]
    public class ScriptedImporterAttribute : Attribute
    {
        public ScriptedImporterAttribute(int version, string[] exts, string[] overrideExts, int importQueueOffset) { }
    }

    public abstract class ScriptedImporter : AssetImporter
    {
        public abstract void OnImportAsset(AssetImportContext ctx);
    }

    public class AssetImportContext
    {
        public string assetPath { get; internal set; }
        public void AddObjectToAsset(string identifier, Object obj) { Objects[identifier] = obj; }
        public void SetMainObject(Object obj) { Main = obj; }
        public void DependsOnSourceAsset(string path) { Dependencies.Add(path); }
        public void DependsOnArtifact(string path) { Dependencies.Add(path); }
        public void LogImportError(string msg, Object obj = null) { Errors.Add(msg); }
        public void LogImportWarning(string msg, Object obj = null) { Errors.Add(msg); }

        internal Object Main;
        internal readonly Dictionary<string, Object> Objects = new Dictionary<string, Object>();
        internal readonly List<string> Dependencies = new List<string>(), Errors = new List<string>();
    }
}

namespace VRCLightVolumes
{
    using UnityEngine;

    public class LightVolumeManager : MonoBehaviour
    {
        public Editor.LightVolumeManagerEditorContext Editor
        {
            get { return new Editor.LightVolumeManagerEditorContext { Manager = this }; }
        }

        internal Vector3[][] Volumes;
        internal readonly Dictionary<int, object[]> Baked = new Dictionary<int, object[]>();
    }
}

namespace VRCLightVolumes.Editor
{
    using UnityEngine;

    public struct LightVolumeManagerEditorContext { internal LightVolumeManager Manager; }

    public static class LightVolumeManagerEditorExtensions
    {
        public static int GetCustomProbesCount(this LightVolumeManagerEditorContext editor)
        {
            return editor.Manager.Volumes.Length;
        }
        public static Vector3[] GetCustomProbes(this LightVolumeManagerEditorContext editor, int id)
        {
            return (Vector3[])editor.Manager.Volumes[id].Clone();
        }
        public static void SetCustomProbesBaked(this LightVolumeManagerEditorContext editor, int id, Vector3[] l0,
                                                Vector3[] l1r, Vector3[] l1g, Vector3[] l1b, float[] validity,
                                                bool denoise)
        {
            editor.Manager.Baked[id] = new object[] { l0, l1r, l1g, l1b, validity, denoise };
        }
    }
}
